# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The rows of the catalogues of commands.

A row contains everything about a command that does not depend on the race. Race control has one
catalogue (``evgp_rcs.rules.catalogue``), and the timekeeper has another
(``evgp_timing.corrections``). The nodes, the windows and `rcs_ctl` are built from these rows.

This module is pure.
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
    What a screen shows once a command has taken effect. An empty field means that anything fits.

    :param race: the race is in one of these states.
    :param hold: the kart's hold is one of these, where ``None`` means no hold.
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
    The row of one command.

    :param label: text of the command's button. RED RED for one kart and for all karts have the
        same text, because their places differ.
    :param meaning: what the command does, in a few words.
    :param service: name of the command's service below race control's node or, with the prefix
        `OF_TIMEKEEPER`, below the timekeeper's. Two commands may share a service. Every request
        has `official`, the name that the sender claims.
    :param fixed: fields of the request that select this command if two commands share a service.
    :param result: what is true once the command has taken effect.
    :param undoes: the command that this one undoes. The two share a button, which offers this
        command while the result of the other is in effect.
    :param note: a sentence that the confirmation adds after the list of what karts are sent.
    :param statement: the field of the request for the official's statement; empty if none.
    :param call_is_statement: whether calling the service is itself the statement.
    :param to_one_kart: whether the request names a kart (`kart`).
    :param takes: the other fields of the request, with the same names as in ``Command``. `karts`,
        `hold`, `opening` and `reading` say what the official saw. Of two commands that share a
        service, each has only the fields that it uses.
    :param flag: the option of `rcs_ctl` for a statement, and what it states; None if none.
    :param word: the command's name in `rcs_ctl`, if it differs from the name of the kind.
    :param short: text of the button where there is little room, if it differs from `label`.
    :param place: position of the button from the left, in the line of the race or, for a command
        to one kart, in the kart's row; 0 for no button there. A command that undoes another has
        the same place as that one.
    :param key: key of the button. A command to one kart goes to the selected kart.
    :param does: the button's description of the command. ``{karts}`` stands for the number of
        karts that it starts or releases.
    :param follows: a text that says when the command is usual, shown in other race states.
    :param condition: what an official confirms if race control asks for no statement. ``{kart}``
        stands for the kart.
    :param sends: the state that the command sends, if it asks for confirmation.
    :param then: what follows the command, for one kart and for several.
    :param bookkeeping: whether the command is not a button of §4.B, so that GRID_ACTIVE stays the
        last button pressed.
    :param stop: whether the command stops karts. A stop is never refused for a kart in the roster,
        and never waits behind another command.
    :param loosens: whether the command starts or releases karts, lets humans near them, or changes
        the roster. It is refused whenever officials may not be seeing the current race.
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
        """Return whether an official must confirm the command."""
        return self.loosens or self.call_is_statement

    @property
    def service_type(self) -> str:
        """Return the name of the type in ``evgp_rcs_msgs.srv``, which may be the command's own."""
        name = 'KartCommand' if self.to_one_kart else 'RaceCommand'
        if self.fixed or self.statement or self.takes:
            own = self.service.removeprefix(OF_TIMEKEEPER)
            name = own.title().replace('_', '').replace('/', '')
        return name

    @property
    def overtakes(self) -> bool:
        """Return whether it is processed before other commands. RACE_OVER may still be refused."""
        return self.stop or self.result.race == (RaceState.RED_RED,)

    @property
    def is_seen(self) -> bool:
        """Return whether the race shows that it took effect; if not, only its answer does."""
        return self.result != Result() or 'heat' in self.takes
