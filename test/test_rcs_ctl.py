# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The officials' terminal client, as a process, against a real race control."""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
import functools
import math
import os
import pathlib
import platform
import re
import shlex
import signal
import subprocess
import sys
import threading
import time
from typing import Any

from evgp_node.codec import message_of
from evgp_node.official import UNNAMED
from evgp_node.qos import latched
from evgp_node.rclpy_private import RCLError
from evgp_node.results import Act
from evgp_node.stamps import seconds_of
from evgp_node.states import state_of
from evgp_protocol.clock import now
from evgp_protocol.states import RaceState
from evgp_rcs.rules.catalogue import CATALOGUE, CommandKind
from evgp_rcs.rules.snapshot import NOTHING
from evgp_rcs_console import ctl_ros
from evgp_rcs_console.client import Client, request_message
from evgp_rcs_console.command_line import (
    ARGUMENTS,
    COMMANDS,
    NO_STOP_SENT,
    NOTHING_SENT,
    parse,
    STARTING,
    Told,
)
from evgp_rcs_console.commands import Given, Standing
from evgp_rcs_console.ctl_ros import Hearing
from evgp_rcs_console.texts import GONE_REASON
from evgp_rcs_msgs import msg, srv
from evgp_testing.fixtures import ConnectKart, JoinOfficial, StartRaceControl
from evgp_testing.official import Official, TRIES
from evgp_testing.part import Part, PATIENCE
from evgp_testing.process import executable
from evgp_testing.race_control import RaceControl
from evgp_testing.ros_side import bound, joined, RosSide
from evgp_testing.wire_race import WireRace
from evgp_timing.corrections import CORRECTIONS
import pytest
import rclpy
from rig.terminal import Terminal

ACCEPTED, REFUSED, USAGE, NOT_THERE = 0, 1, 2, 3

CALLS = 'import sys; from evgp_rcs_console.ctl import main; sys.exit(main(sys.argv[1:]))'


def start(domain: int, *words: str, before: str = '') -> subprocess.Popen[str]:
    """
    Start `rcs_ctl` on a domain.

    :param before: Python that its process does first.
    """
    program = [executable('evgp_rcs_console', 'rcs_ctl')]
    return subprocess.Popen(
        [*([sys.executable, '-c', f'{before}\n{CALLS}'] if before else program), *words],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, 'ROS_DOMAIN_ID': str(domain)},
    )


def run(domain: int, *words: str, before: str = '') -> subprocess.CompletedProcess[str]:
    """Run `rcs_ctl` on a domain until it ends."""
    with start(domain, *words, before=before) as process:
        try:
            stdout, stderr = process.communicate(timeout=2 * PATIENCE)
        except subprocess.TimeoutExpired:
            process.kill()
            raise
        return subprocess.CompletedProcess(words, process.returncode, stdout, stderr)


def at_terminal(domain: int, *words: str) -> Terminal:
    """Start `rcs_ctl` as an official does, at a terminal."""
    command = executable('evgp_rcs_console', 'rcs_ctl')
    return Terminal([command, *words], {'ROS_DOMAIN_ID': str(domain)})


class Lines(Part):
    """
    Carries out lines of `rcs_ctl` one after the other, in this process, which starts ROS once.

    :param official: sees the race, too; no line is carried out with an older one.
    """

    def __init__(self, domain: int, official: Official) -> None:
        self._official = official
        self._hearing = Hearing()
        with bound():
            rclpy.init(domain_id=domain, signal_handler_options=rclpy.SignalHandlerOptions.NO)
            self._client = Client('lines', self._hearing, use_global_arguments=False)

    def run(self, *words: str) -> Told:
        """Return what a line has come to, which always has the banner of race control."""
        wanted = parse(['--wait', str(PATIENCE), *words])
        hearing, until = self._hearing, now() + wanted.wait
        seen = self._official.wait_for_race(lambda race: True, 'a first look at the race')
        newest = seconds_of(seen.stamp)
        assert hearing.wait_for(lambda: hearing.race and hearing.race.stamp >= newest, until)
        hearing.answer = hearing.dropped = hearing.given = None
        hearing.standing = ()
        terminal = ctl_ros.Terminal(self._client, hearing, wanted, until)
        told = terminal.show_results() if wanted.command == 'results' else terminal.give(0.0)
        told = ctl_ros._under_banner(told, hearing.race)
        assert hearing.race is not None
        assert hearing.race.banner in told.output + told.error
        return told

    def accepted(self, *words: str) -> str:
        """Give a command that must be accepted, once it is available; return what is printed."""
        form = CATALOGUE[COMMANDS[words[0]]]
        request = {**form.fixed, **({'kart': int(words[1])} if form.to_one_kart else {})}
        for _ in range(TRIES):
            race = self._official.wait_for_available(form.service, **request)
            told = self.run(*words)
            if told.code == ACCEPTED:
                break
            self._official.wait_for_race(lambda newer, seen=race: newer is not seen, 'a newer one')
        assert told.code == ACCEPTED, f'{words}: {told}'
        return told.output

    def close(self) -> None:
        """Leave the domain."""
        self._client.close()
        rclpy.try_shutdown()


@contextlib.contextmanager
def client_of(domain: int, listener: Hearing, there: str = '') -> Iterator[Client]:
    """Provide a client in this process."""
    with joined(domain) as context:
        client = Client('client', listener, context, there=there, use_global_arguments=False)
        try:
            yield client
        finally:
            client.close()


# ----- the command line -------------------------------------------------------------------


def test_every_command_of_an_official_is_there_once_and_fits_its_service() -> None:
    assert {*COMMANDS.values()} == {*CommandKind, *CORRECTIONS}
    for word, command in COMMANDS.items():
        taken = {}
        if isinstance(command, Act):
            entry = CORRECTIONS[command]
            named = [*filter(ARGUMENTS.get, entry.takes)]
            wanted = parse([word, *['1'] * (entry.to_one_kart + len(named))])
            taken = {name: getattr(wanted, name) for name in entry.takes}
        request_message(Given(command, 1, True, taken))


def test_every_statement_that_a_request_takes_has_a_flag() -> None:
    assert all(entry.flag for entry in CATALOGUE.values() if entry.statement)


@pytest.mark.parametrize('name', ['ARGS', 'ARG'])
def test_make_takes_a_stop_by_a_name_that_is_easily_mistyped(name: str) -> None:
    line = ['make', '--dry-run', 'ctl', f'{name}=all-kill']
    root = pathlib.Path(__file__).resolve().parents[1]
    done = subprocess.run(line, cwd=root, capture_output=True, text=True, check=True)
    assert re.search(r' ctl .* all-kill$', done.stdout, re.DOTALL | re.MULTILINE)


NO_PERMISSION = """
from rclpy._rclpy_pybind11 import RCLError
from rclpy.node import Node
def refuse(*_, **__):
    raise RCLError('no permission')
Node.create_client = refuse
"""
"""A stand-in for SROS2, which the wheels' DDS does not have."""

FAILS = 'from evgp_rcs_console import ctl_ros; ctl_ros.attend = lambda *_: 1 / 0'

FEW_CHARACTERS = "import sys; sys.stdout.reconfigure(encoding='ascii')"
"""A terminal that is not of UTF-8."""

INTERRUPTED = """
from evgp_rcs_console import ctl_ros
def interrupt(*_):
    raise KeyboardInterrupt  # as by Ctrl-C while ROS starts
ctl_ros.attend = interrupt
"""


@pytest.mark.parametrize(
    ('before', 'line', 'code', 'said'),
    [
        (FAILS, 'all-kill', NOT_THERE, r'\(rcs_ctl failed; ROS domain(.|\n)*USE THE MSR'),
        (NO_PERMISSION, 'red-flag', USAGE, rf'^.*/officials.*\n{NO_STOP_SENT}\n$'),
        ('', 'red-flag --ros-args --no-such-option', USAGE, rf'\n{NO_STOP_SENT}\n$'),
        (INTERRUPTED, 'red-flag', NOT_THERE, rf'^{NO_STOP_SENT}\n$'),
        (INTERRUPTED, 'close-track', NOT_THERE, rf'^{NOTHING_SENT}\n$'),
        # Without a terminal, nobody is asked for a name.
        ('', 'green-green 1 --wait 0.5', NOT_THERE, '^GREEN GREEN was not sent: .* not found'),
        ('', 'all-kill --wait 0.5', NOT_THERE, 'ROS domain {domain}(.|\n)*USE THE MSR'),
        ('', 'watch --once --wait 0.5', NOT_THERE, 'NO RACE CONTROL YET(.|\n)*domain {domain}'),
    ],
    ids=[
        *('failed itself', 'not allowed', 'wrong setting of ROS', 'interrupted', 'no stop'),
        *('not there', 'stop', 'watch'),
    ],
)
def test_what_cannot_be_sent_or_shown_says_why_and_asks_for_the_msr_only_for_a_stop(
    domain: int, before: str, line: str, code: int, said: str
) -> None:
    done = run(domain, *line.split(), before=before)
    shown = done.stdout + done.stderr

    assert done.returncode == code
    assert re.search(said.replace('{domain}', f'{domain}'), shown), shown
    assert line.startswith(('all-kill', 'red-flag')) or 'USE THE MSR' not in shown


# ----- whatever race control and DDS do ---------------------------------------------------


def test_a_stop_without_an_answer_says_what_is_known_when_interrupted_and_at_its_deadline(
    parts: contextlib.ExitStack, domain: int
) -> None:
    silent = parts.enter_context(RosSide('silent', domain))
    asked, answering = threading.Event(), threading.Event()
    parts.callback(answering.set)

    def answer(request: object, response: object) -> object:
        asked.set()
        answering.wait()
        return response

    silent.node.create_service(srv.RaceCommand, '/rcs/all_kill', answer)
    silent.spin()
    with start(domain, 'all-kill', '--wait', '600') as process:
        assert asked.wait(PATIENCE)
        process.send_signal(signal.SIGINT)
        _, stderr = process.communicate(timeout=PATIENCE)
    done = run(domain, 'all-kill', '--wait', '1')

    assert process.returncode == done.returncode == NOT_THERE
    assert ' s (interrupted; sent ' in stderr
    # On a busy machine ROS takes longer to start, and then less of the second is left.
    started = r'no answer within [01](\.\d)? s \(once ROS had started, which took \d+\.\d s; '
    assert re.search(rf'{started}/rcs/race, ROS domain {domain}', done.stderr)
    for said in (stderr, done.stderr):
        assert 'USE THE MSR' in said


def test_a_client_notices_two_race_controls(parts: contextlib.ExitStack, domain: int) -> None:
    for name in ('one', 'another'):
        side = parts.enter_context(RosSide(name, domain))
        publish = side.node.create_publisher(msg.Race, '/rcs/race', latched(1)).publish
        side.node.create_timer(0.2, functools.partial(publish, message_of(NOTHING, msg.Race)))
        side.spin()
    heard, hearing = side.hear(msg.Presence, '/rcs/presence'), Hearing()
    with client_of(domain, hearing, there='rcs_gui') as client:
        assert hearing.wait_for(lambda: hearing.two, now() + PATIENCE)
        # Neither takes a stop, so nobody can stop the race from here.
        side.wait_until_polled(lambda: client.announce('Anna', '') or heard, 'a presence')
    assert 'cannot find' in heard[0].fault


def test_a_watch_shows_the_race_until_it_ends_and_at_a_terminal_only_somebody_is_there(
    start_race_control: StartRaceControl, join_official: JoinOfficial
) -> None:
    control = start_race_control(in_race=(1,))
    official = join_official(control)
    with start(control.domain, 'watch') as piped:
        assert piped.stdout is not None
        assert any('Race: ⌂ IN GARAGE' in line for line in piped.stdout)
        assert official.node.count_publishers('/rcs/presence') == 0
        piped.stdout.close()  # as by `head`: it ends without a word
        assert piped.wait(PATIENCE) == ACCEPTED
        assert piped.stderr is not None
        assert not piped.stderr.read()

    with contextlib.closing(at_terminal(control.domain, 'watch')) as watch:
        watch.wait_for('1 official can stop the race')
        heard = official.hear(msg.Presence, '/rcs/presence')
        control.close()
        watch.wait_for('RACE CONTROL HAS ENDED: NO STOP WORKS NOW')
        official.wait_until(lambda: heard and heard[-1].fault == GONE_REASON, lambda: str(heard))
        watch.process.send_signal(signal.SIGINT)
        assert watch.end() == ACCEPTED


# ----- a race control that these tests share -----------------------------------------------


HEATS = {'Heat A': (1, 2), 'Final': (2, 3)}


@pytest.fixture(scope='module')
def the_desk(tmp_path_factory: pytest.TempPathFactory) -> Iterator[WireRace]:
    """Return a race control with three karts for the tests that neither end nor freeze it."""
    parameters = {'finish_delays': '[0.1]', 'banner': 'REHEARSAL'}
    folder, karts = tmp_path_factory.mktemp('lasting'), (1, 2, 3)
    with WireRace(folder, (1, 2), (3,), karts, parameters, heats=HEATS) as desk:
        yield desk


def clear(desk: WireRace) -> None:
    """Have the race in the garage without kart or hold, whatever the test before has left."""
    official = desk.official
    official.wait_for_race(
        lambda race: not any(kart.connected for kart in race.karts), 'every kart away'
    )
    official.command('record_msr')
    official.command('in_garage', track_safe=True)
    race = official.wait_for_race(
        lambda race: state_of(race.state) is RaceState.IN_GARAGE, 'the race in the garage'
    )
    for kart in race.karts:
        if state_of(kart.hold) is not None:
            official.command('kart/in_garage', kart=kart.number, made_safe_by_hand=True)
        if kart.in_race is not (kart.number in desk.racing):
            official.command('set_in_race', kart=kart.number, in_race=not kart.in_race)
    if race.track.open:
        official.command('set_track_open', open=False)


Desks = tuple[RaceControl, Official, Lines]


@pytest.fixture
def desk(the_desk: WireRace, parts: contextlib.ExitStack) -> Desks:
    """Return race control in the garage, an official, and who gives it lines of `rcs_ctl`."""
    clear(the_desk)
    control, official = the_desk.control, the_desk.official
    return control, official, parts.enter_context(Lines(control.domain, official))


def test_every_answer_says_the_banner_so_that_no_rehearsal_is_taken_for_a_race(
    desk: Desks,
) -> None:
    control, official, _ = desk  # and each line of `rcs_ctl` in this file (``Lines.run``)
    for service in ('all_kill', 'green_green'):
        assert official.call(service).message.startswith('REHEARSAL: ')
    done = run(control.domain, 'watch', '--once', '--events', '--wait', str(PATIENCE))
    assert done.returncode == ACCEPTED
    assert 'REHEARSAL' in done.stdout.splitlines()[0]


def test_a_whole_race_by_commands(desk: Desks, connect_kart: ConnectKart) -> None:
    control, official, lines = desk
    kart = connect_kart(control, 2, acknowledges=True)
    connect_kart(control, 3, acknowledges=True)
    official.wait_for_connected(2, 3)

    unknown = lines.run('heat', 'B')
    assert (unknown.code, 'Heat A' in unknown.error) == (REFUSED, True)
    lines.accepted('join', '3')
    lines.accepted('leave', '3')
    assert 'Final' in lines.accepted('heat', 'Final', '--official', 'B\x1bob\n')
    official.wait_for_event(lambda event: event.official == f'Bob ({platform.node()})', 'by Bob')
    watch = 'watch', '--once', '--wait', str(PATIENCE)
    shown = run(control.domain, *watch, before=FEW_CHARACTERS).stdout
    assert 'Heat A: 1, 2\n' in shown
    assert 'Final: 2, 3  (in the race)' in shown
    assert re.search(r'^1 .* \? NO LINK$', shown, re.MULTILINE)
    lines.accepted('open-track', '--no-race-anywhere')
    race = official.wait_for_race(lambda race: race.track.open, 'the track open')
    assert [each.in_race for each in race.karts] == [False, True, True]
    grid_active = 'grid-active', '2', '3', '--track-is-clear'
    asked = lines.run(*grid_active)
    line = asked.error.splitlines()[-1].partition('type: rcs_ctl ')[2].split()
    assert line == [*grid_active, '--closes', str(race.track.opening)]
    lines.accepted(*line)
    official.wait_for_acks(RaceState.GRID_ACTIVE, 2, 3)
    lines.accepted('green-green', '3', '2')
    kart.wait_for_state(RaceState.GREEN_GREEN)
    for line in ('kart-finish 2', 'kart-red-flag 3', 'red-flag', 'race-over'):
        lines.accepted(*line.split())
    official.wait_for_acks(RaceState.RED_RED, 2, 3)
    lines.accepted('open-track', '--no-race-anywhere')
    lines.accepted('close-track')
    lines.accepted('in-garage', '2', '3', '--track-is-safe')
    kart.wait_for_state(RaceState.IN_GARAGE)
    lines.accepted('record-msr', '--msr-was-used')
    kart.wait_for_state(RaceState.RED_RED)
    official.wait_for_available('kart/in_garage', kart=1)
    asked = lines.run('kart-in-garage', '1')
    assert asked.error.endswith('type: rcs_ctl kart-in-garage 1 --made-safe-by-hand')
    for number in (1, 2, 3):
        said = lines.accepted('kart-in-garage', str(number), '--made-safe-by-hand')
        assert f'Releases kart {number} (Team {number}): RED RED' in said
        assert f'Kart {number} (Team {number}) is released' in said
        official.wait_for_kart(number, lambda kart: not (kart.in_race or kart.hold_reason), 'out')
    # The race goes to the garage also when no kart is left in it.
    asked = lines.run('in-garage')
    assert asked.code == USAGE
    assert asked.error.endswith('type: rcs_ctl in-garage --track-is-safe')
    lines.accepted('in-garage', '--track-is-safe')


TYPE = 'rcs_ctl grid-active 1 2 --track-is-clear'
IF_CLEAR = (
    f'If you state that the track is clear of humans (this command closes it), type: {TYPE}\n'
)
NOT_YET = (
    'GREEN GREEN refused: the race is in IN GARAGE; GREEN GREEN is possible only in GRID ACTIVE.\n'
)


def test_what_is_refused_or_lacks_a_word_starts_nothing_and_says_what_to_type(
    desk: Desks, connect_kart: ConnectKart, monkeypatch: pytest.MonkeyPatch
) -> None:
    control, official, lines = desk
    karts = [connect_kart(control, number) for number in (1, 2)]
    official.wait_for_connected(1, 2)
    which = 'GRID ACTIVE now to 2 karts: 1, 2'
    with monkeypatch.context() as called:
        called.setenv('EVGP_CTL', 'make ctl ARGS="%s"')
        typed = 'make ctl ARGS="grid-active 1 2 --track-is-clear"'
        assert typed in lines.run('grid-active', '--track-is-clear').error

    for line, code, *said in (
        ('green-green 1 2', REFUSED, NOT_YET),
        ('green-green', REFUSED, 'GREEN GREEN is possible only in GRID ACTIVE'),
        ('grid-active 1 --track-is-clear', REFUSED, which, f'type: {TYPE}\n'),
        ('grid-active', USAGE, which, IF_CLEAR),
        ('grid-active 1 2', REFUSED, 'state that the track is clear', IF_CLEAR),
        (
            *('grid-active --track-is-clear', USAGE, which, f'{TYPE}\n'),
            'The command is for kart 1 (Team 1), kart 2 (Team 2)',
        ),
        ("--official 'Anna M' grid-active --track-is-clear", USAGE, f"{TYPE} --official 'Anna M'"),
        # The last ones, since every stop begins a pause; and they are not repeated for ever.
        ('kart-red-red 99', REFUSED, '99'),
        ('kart-red-red 0', REFUSED, 'no kart 0'),
    ):
        told = lines.run(*shlex.split(line))
        assert told.code == code, line
        for each in said:
            assert each in f'{told.error}\n', line
    assert {kart.state for kart in karts} == {RaceState.IN_GARAGE}


def test_an_official_is_asked_for_a_name_once_at_a_terminal_only_and_never_before_a_stop(
    desk: Desks, tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    control, official, _ = desk
    monkeypatch.setenv('ROS_HOME', str(tmp_path))
    kept = tmp_path / 'evgp_rcs' / 'official'
    with official.news:
        official.events.clear()
    stop = at_terminal(control.domain, 'all-kill')
    assert stop.end() == ACCEPTED
    broken_off = at_terminal(control.domain, 'close-track')
    broken_off.wait_for(': $')
    broken_off.press('\x03')
    assert broken_off.end() == NOT_THERE  # and sends nothing
    assert not kept.exists()
    first = at_terminal(control.domain, 'close-track')
    first.wait_for(': $')
    first.press('Anna\n')
    assert first.end() == ACCEPTED
    second = at_terminal(control.domain, 'close-track')
    assert second.end() == ACCEPTED

    official.wait_until(
        lambda: len([each for each in official.events if each.kind == each.COMMAND]) >= 3,
        lambda: f'three commands; heard {official.events}',
    )
    names = [each.official for each in official.events if each.kind == each.COMMAND]
    assert names == [f'{name} ({platform.node()})' for name in (UNNAMED, 'Anna', 'Anna')]
    assert kept.read_text() == 'Anna\n'


HANGS = """
import contextlib, ctypes, pathlib
import rclpy
from rclpy.node import Node
from evgp_rcs_console.client import Client

def hang(*_, **__):
    lock, mutex = ctypes.PyDLL(None).pthread_mutex_lock, ctypes.create_string_buffer(64)
    lock(mutex)
    with contextlib.suppress(KeyboardInterrupt):  # one that comes before it hangs
        pathlib.Path({hung!r}).touch()
        lock(mutex)
    lock(mutex)

{where} = hang
"""
"""
`rcs_ctl` with a part that never returns and holds the interpreter's lock, as DDS does when another
process has died with a lock of its shared memory. A stand-in, since that cannot be brought about
at will.
"""

IN_TIME = rf'no answer within {0.5 + STARTING:g} s(.|\n)*USE THE MSR'
"""What is waited for is ROS, which may take its own time to start."""

HUNG = r'USE THE MSR \(ROS has hung; ROS domain'


@pytest.mark.parametrize(
    ('where', 'line', 'interrupts', 'code', 'output', 'error'),
    [
        ('rclpy.init', 'kart-red-red 7 --wait 0.5', 0, NOT_THERE, '', IN_TIME),
        ('Node.create_client', 'all-kill --wait 3600', 2, -signal.SIGINT, '', ''),
        # What it waits for at first is no limit any more.
        ('Client.announce', 'watch --wait 3600', 0, NOT_THERE, '', HUNG),
        ('Node.destroy_node', 'all-kill --wait 20', 0, ACCEPTED, 'RED RED sent', '^$'),
    ],
    ids=['at its deadline', 'interrupted twice', 'a watch', 'after the answer'],
)
def test_a_line_ends_and_says_what_it_knows_when_ros_hangs(
    tmp_path: pathlib.Path,
    the_desk: WireRace,
    where: str,
    line: str,
    interrupts: int,
    code: int,
    output: str,
    error: str,
) -> None:
    hung = tmp_path / 'hung'
    before = HANGS.format(where=where, hung=str(hung))
    with start(the_desk.domain, *line.split(), before=before) as process:
        try:
            ends = time.monotonic() + PATIENCE
            while interrupts and time.monotonic() < ends:
                time.sleep(0.05)  # two of them at once would be one
                if hung.exists():
                    process.send_signal(signal.SIGINT)
                    interrupts -= 1
            stdout, stderr = process.communicate(timeout=PATIENCE)
        finally:
            process.kill()

    assert process.returncode == code
    assert re.search(output, stdout), stdout
    assert re.search(error, stderr), stderr


def test_a_stop_is_sent_although_the_disk_is_full(the_desk: WireRace) -> None:
    """Neither the log, a temporary file nor the answer can be written; the name is not UTF-8."""
    nowhere = "import tempfile; tempfile.tempdir = '/proc'  # nobody can write there"
    official = os.fsdecode('Jürgen'.encode('latin-1'))
    domain = str(the_desk.domain)
    with open('/dev/full', 'w') as full:  # noqa: PTH123
        done = subprocess.call(
            [sys.executable, '-c', f'{nowhere}\n{CALLS}', 'red-flag', '--official', official],
            stdout=full,
            stderr=full,
            timeout=2 * PATIENCE,
            env={**os.environ, 'ROS_DOMAIN_ID': domain, 'ROS_LOG_DIR': '/proc/nowhere'},
        )

    assert done == ACCEPTED


def test_a_command_or_an_announcement_that_cannot_be_sent_keeps_no_stop_from_being_sent(
    the_desk: WireRace, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nor does an announcement, as by a wall clock past 2038, which may be right again later."""

    def fail(message: object) -> None:
        raise RCLError('cannot publish data')

    hearing = Hearing()
    with client_of(the_desk.domain, hearing, there='rcs_gui') as client:
        monkeypatch.setattr(client._there, 'publish', fail)
        client.announce('Anna', '')
        assert client.wait_for(CommandKind.SET_HEAT, PATIENCE)
        client.give(Given(CommandKind.SET_HEAT, taken={'heat': '\udcff'}))
        assert hearing.wait_for(lambda: hearing.answer, now() + PATIENCE)
        assert hearing.answer is not None
        assert 'was not sent' in hearing.answer[1].message
        client.give(Given(CommandKind.RED_FLAG, official='\udcff'))
        client.give(Given(Act.COUNT, 1))  # without a timekeeper
        client.give(Given(CommandKind.ALL_KILL))
        # It waits for nobody who is not there.
        assert hearing.wait_for(lambda: hearing.answer and hearing.answer[1].success, now() + 5.0)
        assert hearing.answer[0].command is CommandKind.ALL_KILL
        assert hearing.wait_for(lambda: hearing.standing[0].said, now() + PATIENCE)


@pytest.mark.parametrize(
    ('heat', 'changed', 'stop_given_at', 'goes_on'),
    [
        ('Final', {'THEN_WITHIN': PATIENCE}, -math.inf, True),
        ('none', {}, -math.inf, False),
        ('Final', {'THEN_WITHIN': 0.0}, -math.inf, False),
        ('Final', {'THEN_WITHIN': PATIENCE}, math.inf, False),
        ('Final', {'Client._finds': lambda *_: False}, -math.inf, False),
        ('Final', {'Client._answered': lambda *_: None, 'GIVE_UP': 0.1}, -math.inf, False),
        ('Final', {'request_message': lambda _: None}, -math.inf, False),
    ],
    ids=['accepted', 'refused', 'late', 'after a stop', 'not there', 'unanswered', 'not sent'],
)
def test_what_was_confirmed_with_a_command_is_sent_once_that_is_accepted_or_else_it_is_told(
    the_desk: WireRace,
    monkeypatch: pytest.MonkeyPatch,
    heat: str,
    changed: dict[str, Any],
    stop_given_at: float,
    goes_on: bool,
) -> None:
    for name, value in changed.items():
        monkeypatch.setattr(f'evgp_rcs_console.client.{name}', value)
    clear(the_desk)
    hearing = Hearing()
    with client_of(the_desk.domain, hearing) as client:
        client._stop_given_at = stop_given_at
        assert client.wait_for(CommandKind.SET_HEAT, PATIENCE)
        then = tuple(Given(CommandKind.JOIN_RACE, kart) for kart in (1, 2))
        give, sent = client.give, list[Given]()
        monkeypatch.setattr(client, 'give', sent.append)
        give(Given(CommandKind.SET_HEAT, taken={'heat': heat}, then=then))
        ends = now() + PATIENCE
        while not sent and not (hearing.answer and not hearing.answer[1].success) and now() < ends:
            client.announce('Anna', '')  # which keeps the client busy
            hearing.wait_for(lambda: hearing.answer, now() + 0.1)
    assert hearing.answer is not None
    assert hearing.answer[1].success is goes_on
    assert ('JOIN kart 1, JOIN kart 2' in hearing.answer[1].message) is not goes_on
    assert [each.kart for each in sent] == [1] * goes_on
    assert all(each.then == then[1:] for each in sent)


def test_that_all_kill_is_accepted_is_told_last(the_desk: WireRace) -> None:
    """However long it takes to tell that it is pressed, unless it is accepted meanwhile."""
    hearing, told, accepted = Hearing(), list[int](), threading.Event()

    def on_pressing(stops: tuple[Standing, ...]) -> None:
        if stops:
            accepted.wait(0.5)
        else:
            accepted.set()
        told.append(len(stops))

    hearing.on_pressing = on_pressing  # type: ignore[method-assign]
    with client_of(the_desk.domain, hearing) as client:
        client.give(Given(CommandKind.ALL_KILL))
        assert hearing.wait_for(lambda: hearing.answer, now() + PATIENCE)

    assert told[-1] == 0
