# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The kit for karts without ROS: ``kit/c/evgp_kart.h`` and ``evgp_protocol.kart``.

The rules are the arbiter's, which has its own proof. Here the header is held against them: the
same random inputs, the same answers; and the examples drive a race of the real race control.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
import contextlib
import dataclasses
import functools
import importlib
import itertools
import json
import os
import pathlib
import random
import re
import shutil
import socket
import struct
import subprocess
import sys
import time

from catkin_pkg.package import parse_package
from evgp_protocol.arbiter import Settings, StopSource
from evgp_protocol.frames import encode
from evgp_protocol.kart import Kart
from evgp_protocol.states import RaceState
from evgp_rcs_msgs.msg import RaceState as Message
from evgp_testing.fixtures import JoinOfficial, StartRaceControl
from evgp_testing.part import PATIENCE
from evgp_testing.process import Program
from evgp_testing.race_control import address_of
import pytest
from rig.bare_race_control import BareRaceControl, BEAT
from rig.needs import cannot_run
from test_wire_document import client_at
import yaml

ROOT = pathlib.Path(__file__).parents[1]
KIT = ROOT / 'kit/c'
HEADER = KIT / 'evgp_kart.h'
README = (KIT / 'README.md').read_text(encoding='utf-8')
WARNINGS = ('-Wall', '-Wextra', '-Wpedantic', '-Werror', '-Wconversion', '-Wshadow')
SANITIZED = ('-O0', '-g', '-fsanitize=address,undefined', '-fno-sanitize-recover=all')
C99, CPP17 = ('-std=c99', '-x', 'c'), ('-std=c++17', '-x', 'c++')
TARGETS = {
    '-m32': ('gcc', '-m32'),
    'cortex-m0': ('arm-none-eabi-gcc', '-mthumb', '-mcpu=cortex-m0'),
    'cortex-m4': ('arm-none-eabi-gcc', '-mthumb', '-mcpu=cortex-m4'),
    'aarch64': ('aarch64-linux-gnu-gcc', '-static'),
}
"""The compiler, and its flags, for each kind of machine that this one is not."""

BOARD = (
    'qemu-system-arm -display none -monitor none -serial none '
    '-semihosting-config enable=on,target=native -M {} -kernel'
)
EMULATORS = {
    'cortex-m0': BOARD.format('microbit'),
    'cortex-m4': BOARD.format('netduinoplus2'),
    'aarch64': 'qemu-aarch64',
}
"""
What runs a program for such a machine. The boards have flash from 0 on, memory from 0x20000000 on;
their files and their standard input and output are this machine's (semihosting).
"""

COMPILERS = [each for each in ('gcc', 'clang') if shutil.which(each)]
GREEN, GRID = RaceState.GREEN_GREEN, RaceState.GRID_ACTIVE
FLAG, RED = RaceState.RED_FLAG, RaceState.RED_RED

STOPS = {'b': StopSource.SERVICE, 'r': StopSource.TSR, 'm': StopSource.MSR}
"""What the driver calls the sources of a team stop."""

Compile = Callable[..., pathlib.Path]


def lacks(what: str) -> None:
    """Skip the test, since this machine lacks something of what other machines are built for."""
    pytest.skip(f'this machine has no {what} (docs/dev/testing.md)')


@pytest.fixture(scope='module')
def compile_kit(tmp_path_factory: pytest.TempPathFactory) -> Compile:
    """Return a function that compiles a file of the kit without a warning."""
    if not COMPILERS:
        cannot_run('there is neither gcc nor clang')

    def compile_it(
        source: str,
        *flags: str,
        compiler: str = 'gcc' if 'gcc' in COMPILERS else 'clang',
        kit: pathlib.Path = KIT,
    ) -> pathlib.Path:
        program = tmp_path_factory.mktemp('kit') / 'program'
        command = [compiler, *WARNINGS, *flags, f'-I{kit}', str(KIT / source)]
        if 'c++' in flags and '-m32' not in flags:  # the driver of C links no C++
            command += ['-lstdc++']
        done = subprocess.run([*command, '-o', str(program)], capture_output=True, text=True)
        assert done.returncode == 0, f'{" ".join(command)}\n{done.stderr}'
        return program

    return compile_it


def flags_for(target: str) -> tuple[str, ...]:
    """Return the compiler and its flags for a machine of TARGETS."""
    command = TARGETS[target]
    found = shutil.which(command[0]) and subprocess.check_output(
        [*command, '-print-file-name=libc.a'], text=True
    )
    if '/' not in (found or ''):
        lacks(f'{" ".join(command)} with a C library')
    return command


def compile_for(compile_kit: Compile, target: str, source: str) -> pathlib.Path:
    """Return a program that runs a file of the kit on a machine of TARGETS, or on this one: ''."""
    if not target:
        return compile_kit(source, *C99, *SANITIZED)
    compiler, *flags = flags_for(target)
    if target not in EMULATORS:
        return compile_kit(source, *C99, *flags, '-O2', compiler=compiler)
    emulator = EMULATORS[target]
    if not shutil.which(emulator.split()[0]):
        lacks(emulator.split()[0])
    if emulator.startswith(BOARD.split()[0]):
        flags += ['--specs=rdimon.specs', '-Wl,--section-start=.vectors=0']
        flags += ['-Wl,-Tdata=0x20000000', str(KIT / 'test/cortex_m.c')]
    program = compile_kit(source, *C99, '-Os', *flags, compiler=compiler)
    emulated = program.with_suffix('.sh')
    emulated.write_text(f'#!/bin/sh\nexec {emulator} {program}\n', encoding='utf-8')
    emulated.chmod(0o755)
    return emulated


# ----- the header against the arbiter --------------------------------------------------------


@dataclasses.dataclass(frozen=True)
class History:
    """Inputs of a kart as the driver reads them, what must hold after each, and what occurred."""

    inputs: bytes
    answers: list[bytes]
    story: list[str]
    seen: Counter[str]


def state_number(state: RaceState | None) -> int:
    return int(getattr(Message, 'UNKNOWN' if state is None else state.value))


def answer_of(kart: Kart, said: bytes) -> bytes:
    """Return what the driver must write."""
    verdict = kart.verdict
    assert bool(kart.last_malformed) is (kart.malformed > 0)
    return struct.pack(
        '<II9B3x',
        verdict.order,
        kart.malformed,
        state_number(verdict.state),
        state_number(verdict.commanded),
        verdict.may_drive,
        kart.is_open,
        verdict.team_stop,
        verdict.acknowledged,
        said[2] if said else 0,
        len(said),
        bool(verdict.reason),
    )


def rubbish(chance: random.Random) -> bytes:
    return chance.choice(
        [
            bytes(chance.choices(b'$;$;RED_ \r\n\t\0\x80\xffx', k=chance.randint(1, 40))),
            chance.randbytes(chance.randint(1, 40)),
            b'$' + b'R' * chance.randint(28, 33) + chance.choice([b';', b'']),
            chance.choice(
                [b'$READY;', b'$red_red;', b'$;', b' ', b'\r\n', b'\0', b'$RED_RED', b'$GREEN']
            ),
        ]
    )


def live(chance: random.Random, count: int, index: int) -> History:
    """
    Return a random history. Its times are in milliseconds, and so are the arbiter's here.

    :param index: chooses the settings.
    """
    frame_timeout = (1000, 1000, 200)[index % 3]
    flag_time = (15000, 300, 40, 0)[index % 4]
    remote_timeout = (0, 0, 0, 0, 500)[index % 5]
    msr_timeout = (0, 0, 0, 400, 400)[index % 5]
    garage = chance.random() < 0.5
    kart = Kart(
        Settings(
            frame_timeout=frame_timeout,
            red_flag_drive_time=flag_time,
            tsr_timeout=remote_timeout,
            msr_timeout=msr_timeout,
            drive_in_garage=garage,
        )
    )
    now = 2**32 - chance.randint(0, 200_000)  # the counter starts again at 0 soon
    kart.tick(now)
    times = (frame_timeout, flag_time, remote_timeout, msr_timeout)
    inputs = [struct.pack('<IIIIBI', *times, garage, now % 2**32)]
    answers, story = [], []
    seen: Counter[str] = Counter()
    state, kept, old_order = RaceState.IN_GARAGE, b'', 0
    way = [RaceState.IN_GARAGE, GRID, GREEN, FLAG, RED]
    for _ in range(count):
        luck, deadline = chance.random(), kart._arbiter.deadline
        rolls = kart.verdict.may_drive and kart.verdict.state is FLAG  # seldom, and soon over
        if luck < (0.2 if rolls else 0.02) and deadline is not None and deadline > now:
            now = int(deadline) + chance.choice([-1, 0, 1])
        elif luck < 0.022:
            now -= chance.randint(1, chance.choice([20, 3000]))
        elif luck < 0.023:
            now += chance.choice([2**31 - 1, 2**31, 2**31 + 5000, 2**32 - 5000])
        elif luck < 0.6:
            now += chance.randint(0, 40)
        if not kart.is_open and chance.random() < 0.5:
            kind = 'c'
        elif rolls and chance.random() < 0.1:
            kind = 'b'
        else:
            kind = chance.choices('datcxbrmie', [54, 24, 6, 0.2, 0.1, 5, 6, 6, 0.2, 0.1])[0]
        value, data, said = 0, b'', b''
        if kind == 't':
            kart.tick(now)
        elif kind == 'c':
            kart.connected(now)
            kept = b''
        elif kind in 'xe':  # closed, or what could not be read
            kart.closed(now)
        elif kind == 'i':  # no source at all: a stop, whatever it says
            value = chance.random() < 0.5
            kart.team_stop(True, now)
        elif kind in STOPS:
            value = chance.random() < (0.3 if kind == 'b' else 0.04)
            kart.team_stop(value, now, STOPS[kind])
        elif kind == 'a':
            value = kart.verdict.order
            if chance.random() < 0.15:
                value = chance.choice([0, old_order, value + 1, chance.randrange(2**32)])
            elif chance.random() < 0.2:
                old_order = value
            said = kart.acknowledge(value, now)
        else:
            for _ in range(chance.randint(0, 3)):
                if chance.random() < 0.1:  # the usual way of a race, or anything
                    state = way[(way.index(state) + 1) % len(way)]
                elif chance.random() < 0.02:
                    state = chance.choice(way)
                kept += encode(state) if chance.random() < 0.93 else rubbish(chance)
            value = len(kept) if chance.random() < 0.7 else chance.randint(0, len(kept))
            data, kept = kept[:value], kept[value:]
            kart.received(data, now)
        inputs.append(struct.pack('<cII', kind.encode(), now % 2**32, value) + data)
        answers.append(answer_of(kart, said))
        verdict = kart.verdict
        story.append(f'{now} {kind} {value} {data!r}: {verdict} {said!r}')
        commanded = verdict.commanded.value if verdict.commanded else 'nothing'
        seen[f'obeys {verdict.state.value} under {commanded}'] += 1
        seen[f'says {said.decode()}'] += 1
        seen[f'says {said.decode()} under {commanded}'] += 1
        seen['says IN_GARAGE before another word'] += said.startswith(b'$IN_GARAGE;$')
        seen['rolls out'] += verdict.may_drive and verdict.state is FLAG
        seen['takes a stop'] += verdict.team_stop
    return History(b''.join(inputs), answers, story, seen)


def difference(driver: pathlib.Path, history: History) -> str:
    """Return the first input after which the header and the arbiter differ; empty: none."""
    done = subprocess.run([str(driver)], input=history.inputs, capture_output=True)
    if done.returncode != 0:
        return f'it ended with {done.returncode}: {done.stderr.decode(errors="replace")}'
    answers = [found for (found,) in struct.iter_unpack('20s', done.stdout)]
    assert len(answers) == len(history.answers)
    for index, (found, right) in enumerate(zip(answers, history.answers, strict=True)):
        if found != right:
            story = '\n'.join(history.story[: index + 1][-6:])
            return f'{story}\n{found.hex(" ")} is not\n{right.hex(" ")}'
    return ''


NEEDED = (
    'obeys GREEN_GREEN under GREEN_GREEN',
    'obeys RED_RED under GREEN_GREEN',
    'obeys RED_RED under RED_FLAG',
    'obeys RED_FLAG under RED_FLAG',
    'obeys RED_RED under nothing',
    'rolls out',
    'takes a stop',
    'says ',
    *(f'says {encode(state).decode()}' for state in RaceState),
    'says IN_GARAGE before another word',
    'says $RED_RED; under GRID_ACTIVE',
    'says $RED_RED; under GREEN_GREEN',
)
"""What the inputs must lead to: otherwise that the answers are the same says little."""


@pytest.mark.timeout(600)
@pytest.mark.parametrize(
    ('histories', 'inputs'), [(5, 4000), pytest.param(40, 10_000, marks=pytest.mark.long)]
)
def test_the_header_and_the_arbiter_give_the_same_answers(
    compile_kit: Compile, chance: random.Random, histories: int, inputs: int
) -> None:
    drivers = [compile_kit('test/driver.c', *each, *SANITIZED) for each in (C99, CPP17)]
    seen: Counter[str] = Counter()
    for index, driver in zip(range(histories), itertools.cycle(drivers)):
        history = live(chance, inputs, index)
        assert difference(driver, history) == ''
        seen += history.seen
    assert min(seen[each] for each in NEEDED) >= 10, seen


@pytest.mark.parametrize('target', TARGETS)
def test_the_header_gives_the_same_answers_on_another_machine(
    compile_kit: Compile, chance: random.Random, target: str
) -> None:
    driver = compile_for(compile_kit, target, 'test/driver.c')
    for index in (0, 4):
        assert difference(driver, live(chance, 4000, index)) == ''


# ----- the board around it -------------------------------------------------------------------


@pytest.mark.parametrize('target', ['', *TARGETS])
def test_a_board_stops_without_a_link_and_comes_back(compile_kit: Compile, target: str) -> None:
    board = compile_for(compile_kit, target, 'test/board.c')

    done = subprocess.run([str(board)], capture_output=True, text=True)

    assert done.returncode == 0, done.stdout
    assert min(int(count) for count in done.stdout.split()) >= 50  # each thing happened, and often


# ----- faults --------------------------------------------------------------------------------


FAULTS = [
    ('>= kart->settings.frame_timeout_ms', '> kart->settings.frame_timeout_ms'),
    ('(backwards || (uint32_t)(now - kart->heard_at)', '((uint32_t)(now - kart->heard_at)'),
    ('            (backwards ||\n', '            (\n'),
    (': source == EVGP_STOP_MSR  ? kart->settings.msr_timeout_ms', ': 0 ? 0U'),
    ('source == EVGP_STOP_REMOTE || source == EVGP_STOP_MSR', 'source == EVGP_STOP_REMOTE'),
    ('kart->source_at[own] = now', 'kart->source_at[EVGP_STOP_REMOTE] = now'),
    ('(uint32_t)(now - kart->now) > UINT32_MAX / 2U', 'now < kart->now'),
    ('(uint32_t)(now - kart->heard_at) >=', 'now >= kart->heard_at +'),
    ('(uint32_t)(now - kart->slowing_since) >=', '(uint32_t)(now - kart->slowing_since) >'),
    ('>= evgp_p_timeout(kart, source)', '> evgp_p_timeout(kart, source)'),
    ('kart->out || evgp_p_team_stop(kart)', 'kart->out'),
    ('kart->commanded == EVGP_GREEN_GREEN && !kart->armed', '0'),
    ('            kart->armed = 0;\n            kart->out', '            kart->out'),
    ('    kart->order = 0;\n', ''),
    ('    kart->commanded = EVGP_NONE;\n', ''),
    ('        kart->armed = 0;\n        kart->out = 1;\n', '        kart->out = 1;\n'),
    ('        kart->armed = 0;\n        kart->out = 1;\n', ''),
    ('    kart->slowing = 0;\n    if (kart->armed) {', '    if (kart->armed) {'),
    ('    if (kart->armed) {', '    if (kart->commanded == EVGP_GRID_ACTIVE) {'),
    ('        kart->acknowledged = 0;\n        evgp_p_number', '        evgp_p_number'),
    ('        evgp_p_number(kart); /* a program', '        /* a program'),
    ('        kart->acknowledged = 0;\n        kart->slowing =', '        kart->slowing ='),
    ('was_driving && state == EVGP_RED_FLAG', 'state == EVGP_RED_FLAG'),
    ('    if (kart->stopped && !stopped) {', '    if (0) {'),
    ('            kart->armed = 1;\n', ''),
    ('    if (order == kart->order &&', '    if ('),
    ('kart->said_order != order || kart->heard_since_said', '1'),
    ('            kart->garage_owed = 1;\n', ''),
    ('            kart->garage_owed = 0;\n', ''),
    ('    kart->garage_owed = 0;\n    kart->frame_bytes', '    kart->frame_bytes'),
    ('            kart->malformed++; /* cut off', '            /* cut off'),
    ('        kart->skipping = 0;\n        kart->frame[0]', '        kart->frame[0]'),
    ('byte > 127U || ', ''),
    ('EVGP_MAX_FRAME_BYTES - 1)', 'EVGP_MAX_FRAME_BYTES - 2)'),
    ('EVGP_MAX_FRAME_BYTES - 1)', 'EVGP_MAX_FRAME_BYTES)'),
    ('    kart->frame_bytes = 0;\n    kart->skipping = 0;\n', ''),
    ('i < count && kart->open', 'i < count'),
    ('return kart->settings.drive_in_garage != 0;', 'return 0;'),
    ('return kart->slowing != 0;', 'return 1;'),
    ('kart->out || evgp_p_team_stop(kart)', 'evgp_p_team_stop(kart)'),
    ('return kart->out      ', 'return 0      '),
    ('to_race && evgp_p_obey(kart) != kart->commanded', '0'),
    ('to_race && evgp_p_obey(kart) != kart->commanded', 'evgp_p_obey(kart) != kart->commanded'),
    ('        kart->out = 1;\n', ''),
    ('            kart->out = 0;\n', ''),
    ('    kart->out = 0;\n    kart->slowing', '    kart->slowing'),
    ('!(kart->out && kart->acknowledged)', '1'),
    ('EVGP_GRID_ACTIVE && !kart->out) {', 'EVGP_GRID_ACTIVE) {'),
    ('stop != 0 || (int)source != own', 'stop != 0'),
    ('    if (count > SIZE_MAX / 2U) {', '    if (0) {'),
    ('kart->heard_at = kart->turn_before', 'kart->heard_at = kart->turn'),
    ('    kart->turn_before = now;\n', ''),
    ('EVGP_IN_GARAGE = 1', 'EVGP_IN_GARAGE = 6'),  # not the number of the message
]

BOARD_FAULTS = [
    ('    board->hardware->act(EVGP_BRAKE);\n', ''),
    ('    evgp_kart_closed(&board->kart, board->hardware->now());\n', ''),
    ('    board->hardware->close();\n', ''),
    ('reads < 16', 'reads < 64'),
    ('return evgp_kart_verdict(&board->kart).open;', 'return 1;'),
    ('        evgp_kart_received(&board', '        if (count > 0) evgp_kart_received(&board'),
    ('        if ((size_t)count > sizeof bytes) {', '        if (count < 0) {'),
    ('        if ((size_t)count > sizeof bytes) {', '        if (count > 256) {'),
    ('    return 0; /* race control never', '    return 1; /* race control never'),
    ('2U * board->wait < first ? first : 2U * board->wait', 'first'),
    ('board->wait > last ? last : board->wait', 'board->wait'),
    ('return moves > 0;', 'return moves != 0;'),
    ('return moves > 0;', 'return 1;'),
    ('(moves != 0 || board->drives)', '(moves != 0)'),
    ('(moves != 0 || board->drives)', '(moves > 0 || board->drives)'),
    ('(moves != 0 || board->drives)', '(moves != 0 || action == EVGP_DRIVE)'),
    ('>= EVGP_STANDSTILL_MS', '>= 300'),
    ('!verdict.may_drive  ', 'verdict.obey == EVGP_RED_RED  '),
    ('        board->moved_at = now;\n', ''),
    ('        board->wait = EVGP_CONNECT_FIRST_MS; /* the', '        /* the'),
    ('(!joined || !evgp_p_listen(board))', '!evgp_p_listen(board)'),
    ('>= board->wait)', '> 0)'),
    ('    if (verdict.commanded != EVGP_NONE) {', '    if (0) {'),
    ('    if (verdict.commanded != EVGP_NONE) {', '    if (1) {'),
    ('== EVGP_RED_FLAG    ? EVGP_SLOW_DOWN', '== EVGP_RED_FLAG ? EVGP_DRIVE'),
    ('hardware->write(say, strlen(say)) <= 0', 'hardware->write(say, strlen(say)) < 0'),
    ('hardware->write(say, strlen(say)) <= 0', '!hardware->write(say, strlen(say))'),
    (': EVGP_RELEASE;', ': EVGP_DRIVE;'),
    (
        '    hardware->act(action); /* first, because a sensor may hang */\n'
        '    moves = hardware->moves();\n',
        '    moves = hardware->moves();\n    hardware->act(action);\n',
    ),
    ('        hardware->act(EVGP_BRAKE); /* a known', '        /* a known'),
    ('hardware->connect() > 0', 'hardware->connect()'),
    ('hardware->ready() > 0', 'hardware->ready()'),
    ('hardware->joined() > 0', 'hardware->joined()'),
    ('kart->heard_at = kart->turn_before', 'kart->heard_at = kart->now'),
]


@functools.cache
def history_of(index: int) -> History:
    return live(random.Random(300 + index), 4000, index)  # of these, the first few find each fault


@pytest.mark.parametrize(
    ('source', 'old', 'new'),
    [
        *(('driver', *each) for each in FAULTS),
        *(('board', *each) for each in BOARD_FAULTS),
    ],
)
def test_a_fault_in_the_headers_is_found(
    compile_kit: Compile, tmp_path: pathlib.Path, source: str, old: str, new: str
) -> None:
    texts = {each.name: each.read_text(encoding='utf-8') for each in KIT.glob('*.h')}
    assert sum(text.count(old) for text in texts.values()) == 1, old
    for name, text in texts.items():
        (tmp_path / name).write_text(text.replace(old, new), encoding='utf-8')
    program = compile_kit(f'test/{source}.c', *C99, '-w', kit=tmp_path)

    if source == 'driver':
        assert any(difference(program, history_of(index)) for index in range(20))
    else:
        done = subprocess.run([str(program)], capture_output=True, text=True)
        assert (done.returncode, done.stdout[:6]) == (1, 'broken')


# ----- compilers -----------------------------------------------------------------------------


@pytest.mark.parametrize('target', [*(COMPILERS or ['gcc']), *TARGETS])
@pytest.mark.parametrize('optimised', ['-O0', '-O2'])
@pytest.mark.parametrize('standard', ['c99', 'c11', 'c++11', 'c++17'])
def test_the_headers_compile_without_a_warning(
    compile_kit: Compile, tmp_path: pathlib.Path, target: str, optimised: str, standard: str
) -> None:
    language = 'c++' if '++' in standard else 'c'
    source = tmp_path / 'all_zero.c'
    # A kart that nobody initialised must stand, too.
    source.write_text(
        '#include "evgp_board.h"\n'
        'static evgp_kart kart;\n'
        'int main(void) {\n'
        '    evgp_kart_connected(&kart, 5);\n'
        '    evgp_kart_received(&kart, "$GRID_ACTIVE;", 13, 5);\n'
        '    (void)evgp_kart_acknowledge(&kart, evgp_kart_verdict(&kart).order, 5);\n'
        '    evgp_kart_received(&kart, "$GREEN_GREEN;", 13, 5);\n'
        '    return evgp_kart_verdict(&kart).obey != EVGP_RED_RED;\n'
        '}\n',
        encoding='utf-8',
    )
    compiler, *machine = flags_for(target) if target in TARGETS else (target,)
    only_compile = ('-c',) if target in EMULATORS else ()
    flags = (f'-std={standard}', optimised, '-Wsign-conversion', *only_compile, '-x', language)

    program = compile_kit(str(source), *machine, *flags, compiler=compiler)

    assert only_compile or subprocess.run([str(program)]).returncode == 0


# ----- as a library --------------------------------------------------------------------------


def test_the_manifests_agree_with_the_packages_and_name_what_is_there() -> None:
    properties = (KIT / 'library.properties').read_text(encoding='utf-8')
    arduino = dict(line.split('=', 1) for line in properties.splitlines())
    platformio = json.loads((KIT / 'library.json').read_text(encoding='utf-8'))
    idf = yaml.safe_load((KIT / 'idf_component.yml').read_text(encoding='utf-8'))
    package = parse_package(ROOT / 'src/evgp_protocol')
    versions = {arduino['version'], platformio['version'], idf['version']}
    assert versions == {package.version}
    assert {arduino['url'], platformio['homepage'], idf['url']} == {package.urls[0].url}
    assert {platformio['license'], idf['license']} == {package.licenses[0]}
    assert arduino['name'] == platformio['name']
    headers = {each.name for each in KIT.glob('*.h')}
    assert {*platformio['headers']} == headers >= {arduino['includes']}
    assert [*KIT.rglob(HEADER.name)] == [HEADER]
    assert all(each.stem == each.parent.name for each in KIT.rglob('*.ino'))  # Arduino's rule


def test_a_kart_takes_no_more_of_a_cortex_m0_than_the_readme_says() -> None:
    flags_for('cortex-m0')
    sizes = subprocess.check_output(['make', '-s', 'kit-size'], cwd=ROOT, text=True)
    rows = re.findall(r'^\| `evgp_\w+\.h`.*\| ([\d,]+) \| ([\d,]+) \|$', README, re.MULTILINE)
    said = [[int(number.replace(',', '')) for number in row] for row in rows]
    taken = [[int(number) for number in line.split()[:3]] for line in sizes.splitlines()[1::2]]
    assert len(said) == len(taken) == 2
    for (flash, memory), (text, data, bss) in zip(said, taken, strict=True):
        assert text + data <= flash <= 1.1 * (text + data)
        assert data + bss == memory


# ----- the examples --------------------------------------------------------------------------


EXAMPLES = ('posix.c', 'ESP32', 'W5500', 'example.py')
ON_A_COMPUTER = pytest.mark.parametrize('example', ['posix.c', 'example.py'])
StartExample = Callable[..., Program]


@pytest.fixture(scope='module')
def command_of(request: pytest.FixtureRequest) -> Callable[[str], tuple[str, ...]]:
    """Return what gives an example's command; the port and the kart's address follow."""

    @functools.cache
    def command(name: str) -> tuple[str, ...]:
        if name == 'example.py':
            return sys.executable, str(ROOT / 'kit/python/example.py'), '127.0.0.1'
        compile_it = request.getfixturevalue('compile_kit')
        if name == 'posix.c':
            return str(compile_it('examples/posix.c', *C99, *SANITIZED)), '127.0.0.1'
        flags = (*CPP17, *SANITIZED, f'-I{KIT / "test/arduino"}', f'-D{name}')
        race_control = '-DEVGP_RACE_CONTROL=IPAddress(127,0,0,1)'
        return (str(compile_it('examples/kart/kart.ino', race_control, *flags)),)

    return command


@pytest.fixture
def start_example(
    command_of: Callable[[str], tuple[str, ...]], parts: contextlib.ExitStack
) -> StartExample:
    """Return a function that starts an example, for race control at a port."""

    def start(name: str, port: int, number: int = 1) -> Program:
        return parts.enter_context(
            Program(name, [*command_of(name), str(port), address_of(number)])
        )

    return start


@ON_A_COMPUTER
def test_an_example_says_why_it_is_not_connected_and_does_not_wait_to_look_a_name_up(
    example: str, command_of: Callable[[str], tuple[str, ...]], parts: contextlib.ExitStack
) -> None:
    def start(address: str) -> Program:
        return parts.enter_context(Program(example, [*command_of(example)[:-1], address]))

    # No TCP connection leads there.
    start('255.255.255.255').wait_for_line('unreachable|cannot be reached')
    assert start('localhost').wait() != 0


def test_the_examples_in_python_do_not_slow_down_gently_once_they_may_not_drive(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as base:
        base.bind(('127.0.0.1', 0))
        base.settimeout(PATIENCE)
        monkeypatch.setenv('BASE', str(base.getsockname()[1]))
        for folder in ('kit/python', 'kit/sim'):
            monkeypatch.syspath_prepend(ROOT / folder)
        example, simulated = map(importlib.import_module, ('example', 'kart'))
        kart = simulated.Kart()

        def wanted(state: RaceState, may_drive: bool) -> float:
            base.sendto(b'5', kart._base.getsockname())
            kart.drive(state, may_drive)
            return float(base.recv(100))

        assert wanted(GREEN, True) > 5.0
        assert wanted(FLAG, True) > 4.0
        assert wanted(FLAG, False) == 0.0
        kart._base.close()

    speeds = []
    for state, may_drive in [(FLAG, True), (FLAG, False), (RED, False)]:
        example._speed = 5.0
        example.drive(state, may_drive)
        speeds.append(example._speed)
    assert speeds[0] > speeds[1] == speeds[2]


def lost(lose: Callable[[], object], *karts: Program) -> None:
    """Lose race control, and return once karts obey RED_RED. They obeyed something else."""
    for kart in karts:
        kart.lines.clear()
    lose()
    for kart in karts:
        kart.wait_for_line('^obey RED_RED')


def test_the_examples_and_the_documents_client_race_and_stop_when_race_control_hangs(
    start_example: StartExample,
    start_race_control: StartRaceControl,
    join_official: JoinOfficial,
    parts: contextlib.ExitStack,
) -> None:
    *numbers, client = range(1, len(EXAMPLES) + 2)
    control = start_race_control(in_race=[*numbers, client])
    official = join_official(control)
    of_the_document = [sys.executable, '-c', client_at(control.port, client)]
    parts.callback(Program('client', of_the_document).kill)
    karts = [
        start_example(name, control.port, number)
        for number, name in zip(numbers, EXAMPLES, strict=True)
    ]
    official.wait_for_connected(*numbers, client)

    for state in (GREEN, FLAG, RED, GREEN):
        official.bring_to(state)  # returns when the karts have acknowledged it
        for kart in karts:
            kart.wait_for_line(f'^obey {state.value}')

    lost(control.freeze, *karts)
    control.thaw()


@pytest.mark.parametrize('text', ['waits', 'has no reader', 'has nowhere to go'])
@ON_A_COMPUTER
def test_text_that_nobody_takes_delays_no_stop_ends_no_kart_and_reaches_no_race_control(
    example: str,
    text: str,
    command_of: Callable[[str], tuple[str, ...]],
    parts: contextlib.ExitStack,
) -> None:
    control = BareRaceControl()
    there, terminal = os.pipe()
    parts.callback(os.close, terminal)
    command = [*command_of(example), str(control.port), address_of(1)]
    if text == 'has nowhere to go':
        command = ['sh', '-c', 'exec "$0" "$@" >&- 2>&-', *command]
    kart = parts.enter_context(subprocess.Popen(command, stdout=terminal, stderr=terminal))
    parts.callback(kart.kill)
    control.wait_for_connections(1)
    control.exchange(GRID)
    if text == 'has no reader':
        os.close(there)
    else:
        parts.callback(os.close, there)
        os.set_blocking(terminal, False)
        with contextlib.suppress(BlockingIOError):
            while True:
                os.write(terminal, bytes(4096))
        os.set_blocking(terminal, True)  # from now on, whatever is printed waits
    for state in (GREEN, RED, GRID, GREEN):
        control.exchange(state)
    assert control.malformed == 0
    control.close()
    time.sleep(1.0)  # so that an attempt to connect has failed
    back = parts.enter_context(BareRaceControl(port=control.port))
    back.wait_for_connections(1)


# test_inspection.py shows it of posix.c, as of the client of docs/wire.md.
@pytest.mark.parametrize('example', EXAMPLES[1:])
def test_an_example_obeys_the_last_of_all_frames_and_drives_off_by_no_green_of_a_new_connection(
    example: str, start_example: StartExample, parts: contextlib.ExitStack
) -> None:
    control = parts.enter_context(BareRaceControl())
    kart = start_example(example, control.port)
    control.wait_for_connections(1)
    control.exchange(GRID)
    kart.lines.clear()
    control.exchange(*[GREEN] * 100, RED)
    kart.wait_for_line('^obey RED_RED')
    assert 'obey GREEN_GREEN' not in kart.output

    for state in (GRID, GREEN):
        control.exchange(state)
    lost(control.fall_silent, kart)
    control.wait_for_connections(2)
    kart.lines.clear()
    control.say(GREEN)
    time.sleep(10 * BEAT)  # that time passes is itself what is awaited
    control.exchange(RED)
    assert 'obey GREEN_GREEN' not in kart.output

    for state in (GRID, GREEN):
        control.exchange(state)
    lost(control.hang_up, kart)  # without a RED_RED
