# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
A row of a catalogue of commands: everything about a command that does not depend on the race.

Race control has one catalogue (``evgp_rcs.rules.catalogue``), and the timekeeper another
(``evgp_timing.corrections``). Nodes, window and `rcs_ctl` use their rows.

Pure.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
import enum

from evgp_protocol.states import RaceState

OF_TIMEKEEPER = 'timekeeper/'
"""Prefix of the names of the timekeeper's services, below race control's node."""


@dataclass(frozen=True)
class Result:
    """
    What a screen shows once a command is in force; empty fields do not matter.

    :param race: the race is in one of these states.
    :param hold: the kart's hold is one of these; ``None`` for no hold.
    :param in_race: whether the kart is in the race.
    :param placed: whether the kart has a finishing place.
    :param track_open: whether the track is open to humans.
    """

    race: tuple[RaceState, ...] = ()
    hold: tuple[RaceState | None, ...] = ()
    in_race: bool | None = None
    placed: bool | None = None
    track_open: bool | None = None


@dataclass(frozen=True)
class Entry:
    """
    One row of the catalogue.

    :param label: text of its button; `RED RED` for one kart and for all, since the place differs.
    :param meaning: what it does, in a few words.
    :param service: the name of its service below race control's node or, with the prefix
        `OF_TIMEKEEPER`, below the timekeeper's; two commands may share one. Every request has
        `official`, the name of the sender as the sender gives it.
    :param fixed: fields of the request that select this command, if two share a service.
    :param result: what is true once it is in force.
    :param undoes: the command that it undoes. The two share a button, which offers this one while
        the result of the other is true.
    :param note: a sentence that the confirmation adds to which karts are sent what.
    :param statement: the field of the request for the official's statement; empty for none.
    :param call_is_statement: calling the service is the statement.
    :param to_one_kart: the request names a kart (`kart`).
    :param names_karts: the request names the karts that the official saw (`karts`).
    :param names_hold: the request names the hold that the official saw (`hold`).
    :param names_heat: the request names a heat (`heat`).
    :param names_number: the field of the request with a number that the official saw: `opening`
        of the track, or `reading` of the roster; empty for none.
    :param takes: further fields of the request, with the same names as in ``Command``.
    :param flag: the option of `rcs_ctl` for a statement, and what it states; None for none.
    :param word: its name in `rcs_ctl`, if not that of the kind.
    :param short: text of its button where there is little room, if not `label`.
    :param place: position of its button from the left, in the line of the race or, for a command
        to one kart, in the kart's row; 0 for no button there. A command that undoes another has
        that one's place.
    :param key: key of its button. A command to one kart goes to the selected kart.
    :param does: what its button says it does; ``{karts}`` is how many it starts or releases.
    :param follows: when it is possible, for a state of the race that does not allow it.
    :param condition: what an official confirms if race control asks for no statement; ``{kart}``
        is the kart.
    :param sends: the state that it sends, if it asks for confirmation.
    :param then: what follows, for one kart and for several.
    :param bookkeeping: it is not a button of §4.B, so GRID_ACTIVE stays the last button pressed.
    :param stop: it stops karts: it is never refused for a kart of the roster, and never waits
        behind another command.
    :param loosens: it starts or releases karts, or lets humans near them: it is refused whenever
        officials may not see the present race.
    """

    label: str
    meaning: str
    service: str
    result: Result = field(default_factory=Result)
    fixed: Mapping[str, bool] = field(default_factory=dict)
    undoes: enum.Enum | None = None
    note: str = ''
    statement: str = ''
    call_is_statement: bool = False
    to_one_kart: bool = False
    names_karts: bool = False
    names_hold: bool = False
    names_heat: bool = False
    names_number: str = ''
    takes: tuple[str, ...] = ()
    flag: tuple[str, str] | None = None
    word: str = ''
    short: str = ''
    place: int = 0
    key: str = ''
    does: str = ''
    follows: str = ''
    condition: str = ''
    sends: RaceState | None = None
    then: tuple[str, str] = ('', '')
    bookkeeping: bool = False
    stop: bool = False
    loosens: bool = False

    @property
    def asks(self) -> bool:
        """Return whether an official must confirm it: it loosens, or sending it is a statement."""
        return self.loosens or self.call_is_statement

    @property
    def service_type(self) -> str:
        """Return the service type, which is its own if the request names more than a kart."""
        name = 'KartCommand' if self.to_one_kart else 'RaceCommand'
        names = self.names_karts or self.names_hold or self.names_heat or self.takes
        if self.fixed or self.statement or names:
            own = self.service.removeprefix(OF_TIMEKEEPER)
            name = own.title().replace('_', '').replace('/', '')
        return f'evgp_rcs_msgs/srv/{name}'

    @property
    def overtakes(self) -> bool:
        """Return whether it is judged before all others; RACE_OVER may still be refused."""
        return self.stop or self.result.race == (RaceState.RED_RED,)

    @property
    def is_seen(self) -> bool:
        """Return whether the race shows that it is in force; otherwise only its answer does."""
        return self.result != Result() or self.names_heat

    @property
    def needs_journal(self) -> bool:
        """Return whether it must be on the disk before any kart is sent anything."""
        return RaceState.GREEN_GREEN in self.result.race
