# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""A running race control and timekeeper: the real nodes, with a roster of loopback addresses."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
import os
import pathlib
import signal

from evgp_rcs.karts.channel import ServerSettings
from evgp_rcs.record.run_mark import place
from evgp_testing.domains import free_port
from evgp_testing.process import freeze, Process
from evgp_testing.usage import family
import yaml

SETTLE_TIME = 0.5
"""Time for which a kart must stand still in tests, in seconds. It is short, because tests run many
races."""


Heats = Mapping[str, Iterable[int] | Mapping[str, object]]


def address_of(number: int) -> str:
    """Return the loopback address by which race control knows a kart (1 to 60000)."""
    if number < 255:
        return f'127.0.1.{number}'
    return f'127.{10 + number // 62500}.{number // 250 % 250}.{1 + number % 250}'


def write_roster(
    folder: pathlib.Path,
    in_race: Iterable[int],
    others: Iterable[int] = (),
    teams: Mapping[int, str] | None = None,
    heats: Heats | None = None,
    addresses: Callable[[int], str] = address_of,
) -> pathlib.Path:
    """Write a roster into a folder, and return its path. For the parameters, see `RaceControl`."""
    racing = set(in_race)
    content: dict[str, object] = {
        'karts': [
            {
                'number': number,
                'team': (teams or {}).get(number, f'Team {number}'),
                'address': addresses(number),
                'in_race': number in racing,
            }
            for number in sorted(racing | set(others))
        ]
    }
    if heats:
        content['heats'] = {
            name: dict(chosen) if isinstance(chosen, Mapping) else list(chosen)
            for name, chosen in heats.items()
        }
    roster = folder / 'karts.yaml'
    roster.write_text(yaml.safe_dump(content, sort_keys=False), encoding='utf-8')
    return roster


def settings(folder: pathlib.Path, roster: pathlib.Path) -> dict[str, object]:
    """
    Return the parameters of a race control with its own port, and with its files in a folder.

    It starts as if none had run on this machine before.
    """
    return {
        'roster': roster,
        'record': folder / 'record.sqlite3',
        'address': '127.0.0.1',
        'port': new_port(),
        'settle_time': SETTLE_TIME,
    }


def new_port() -> int:
    """Return a free port at which no race control is known to have run on this machine."""
    port = free_port()
    for address in ('127.0.0.1', ServerSettings.host):
        place(address, port).unlink(missing_ok=True)  # left by a killed one
    return port


class RaceControl(Process):
    """
    A real ``rcs_node`` on a domain, listening at its own port.

    It starts in IN_GARAGE, like the very first one on a machine. To start it again as if on the
    same machine, pass the same port in the parameters.

    :param folder: the folder for its roster.
    :param in_race: the numbers of the karts in the first race.
    :param others: the numbers of the karts that are only in the roster.
    :param parameters: more ROS parameters of the node.
    :param teams: the names of teams, by the numbers of their karts.
    :param arguments: more ROS arguments of the node.
    :param heats: the heats of the roster, each with its karts or with all its roster fields.
    :param addresses: returns the address of a kart in the roster.
    :param under: a command, with its arguments, that runs race control.
    """

    def __init__(
        self,
        folder: pathlib.Path,
        domain: int,
        in_race: Iterable[int],
        others: Iterable[int] = (),
        parameters: Mapping[str, object] | None = None,
        teams: Mapping[int, str] | None = None,
        arguments: tuple[str, ...] = (),
        heats: Heats | None = None,
        addresses: Callable[[int], str] = address_of,
        under: tuple[str, ...] = (),
        program: str = 'rcs_node',
    ) -> None:
        """Start race control and wait until karts can connect."""
        roster = write_roster(folder, in_race, others, teams, heats, addresses)
        self.domain = domain
        given = {**settings(folder, roster), **(parameters or {})}
        super().__init__('evgp_rcs', program, domain, given, arguments, under)
        try:
            self.port = int(self.wait_for_line(r'listens for .* port (\d+)')[1])
        except BaseException:
            self.close()
            raise
        _, self.kart_server_pid, self.record_pid = family(self.pid)

    @property
    def _pids(self) -> tuple[int, ...]:
        return self.pid, self.kart_server_pid, self.record_pid

    def freeze(self) -> None:
        """Stop all processes of race control, as if the machine hung."""
        for pid in self._pids:
            freeze(pid)

    def lose_power(self) -> None:
        """End all processes at once, so that everything that is not yet written is lost."""
        self.freeze()
        # The record's process goes first, because it keeps writing when the kart server ends.
        for pid in reversed(self._pids):
            os.kill(pid, signal.SIGKILL)
        self.wait()

    def thaw(self) -> None:
        for pid in self._pids:
            os.kill(pid, signal.SIGCONT)


class Timekeeper(Process):
    """
    A real ``timekeeper`` beside a race control, with the same roster.

    :param folder: race control's folder, in which the timekeeper also keeps its book.
    :param parameters: more ROS parameters of the node.
    """

    def __init__(
        self, folder: pathlib.Path, domain: int, parameters: Mapping[str, object] | None = None
    ) -> None:
        own = {'roster': folder / 'karts.yaml', 'book': folder / 'timing.sqlite3'}
        super().__init__('evgp_timing', 'timekeeper', domain, {**own, **(parameters or {})})
        try:
            self.wait_for_line('keeps its book')
        except BaseException:
            self.close()
            raise
