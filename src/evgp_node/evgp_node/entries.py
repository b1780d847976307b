# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
What there is to say of a command that does not depend on the race: a row of a catalogue.

Race control has one (``evgp_rcs.rules.catalogue``), and so has the timekeeper
(``evgp_timing.corrections``). Nodes, window and `rcs_ctl` go by their rows.

Pure.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
import enum

from evgp_protocol.states import RaceState

OF_TIMEKEEPER = 'timekeeper/'
"""The beginning of the names of the timekeeper's services, below race control's node."""


@dataclass(frozen=True)
class Result:
    """
    What a screen shows once a command is in force; an empty field says nothing.

    :param race: the race is in one of these states.
    :param hold: the kart's hold is one of these; ``None`` is no hold.
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

    :param label: what its button says; `RED RED` to one kart or to all, since the place tells.
    :param meaning: what it does, in a few words.
    :param service: the name of its service below race control's node, or behind `OF_TIMEKEEPER`
        below the timekeeper's; two commands may share one.
        Every request has `official`: who gives the command, by their own word.
    :param fixed: the fields of a request that make it this command, where two share a service.
    :param result: what is so once it is in force.
    :param undoes: the command that it takes back. The two share a button, which offers this one
        while the result of the other holds.
    :param note: what a question says of it, besides which karts are sent what; a sentence.
    :param statement: the field of the request that takes the official's statement; empty: none.
    :param call_is_statement: to call the service is the statement.
    :param to_one_kart: the request names a kart (`kart`).
    :param names_karts: the request names the karts that the official saw (`karts`).
    :param names_hold: the request names the hold that the official saw (`hold`).
    :param names_heat: the request names a heat (`heat`).
    :param names_number: the field of the request with a number that the official saw: `opening`,
        of the track; `reading`, of the roster; empty: none.
    :param takes: further fields of the request, as ``Command`` has them.
    :param flag: the option of `rcs_ctl` for a statement, and what it states; empty: none.
    :param word: what `rcs_ctl` calls it, if not as the kind.
    :param short: what its button says where there is little room, if not `label`.
    :param place: of its button, from the left: to the race in the line of the race, to a kart in
        its row; 0: it has no button there. One that undoes another is where that one is.
    :param key: the key of its button. What it is to a kart goes to the chosen one.
    :param does: what its button says it would do; ``{karts}`` is how many it starts or releases.
    :param follows: when it is possible, if the state of the race does not allow it.
    :param condition: what an official confirms if race control asks for no statement; ``{kart}``
        is the kart.
    :param sends: the state that it sends, if it asks first.
    :param then: what follows, to one kart and to several.
    :param bookkeeping: no button of §4.B: GRID_ACTIVE stays the last one that was pressed.
    :param stop: it stops karts: never refused for a kart of the roster, and never behind another.
    :param loosens: it starts or releases karts, or lets humans near: refused whenever it is in
        doubt what officials see.
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
        """Return whether an official confirms it: it loosens, or giving it is a statement."""
        return self.loosens or self.call_is_statement

    @property
    def service_type(self) -> str:
        """Return the type of the service: of its own, if its request names more than a kart."""
        name = 'KartCommand' if self.to_one_kart else 'RaceCommand'
        names = self.names_karts or self.names_hold or self.names_heat or self.takes
        if self.fixed or self.statement or names:
            own = self.service.removeprefix(OF_TIMEKEEPER)
            name = own.title().replace('_', '').replace('/', '')
        return f'evgp_rcs_msgs/srv/{name}'

    @property
    def overtakes(self) -> bool:
        """Return whether it is judged before whatever waits; RACE_OVER may still be refused."""
        return self.stop or self.result.race == (RaceState.RED_RED,)

    @property
    def is_seen(self) -> bool:
        """Return whether the race shows that it is in force; else its answer alone does."""
        return self.result != Result() or self.names_heat

    @property
    def needs_journal(self) -> bool:
        """Return whether it must be on the disk before any kart is told."""
        return RaceState.GREEN_GREEN in self.result.race
