# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
What a confirmation asks: the condition, what the command would do, and any reasons against it.

The module is pure.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import functools

from evgp_node.results import Standings
from evgp_protocol.states import RaceState
from evgp_rcs.rules.catalogue import CommandKind
from evgp_rcs.rules.race import Availability, NO_RACE_ANYWHERE
from evgp_rcs.rules.snapshot import KartSnapshot, Snapshot
from evgp_rcs.words import numbered, STATES, time_of_day
from evgp_rcs_console import texts
from evgp_rcs_console.catalogue import CATALOGUE, Kind
from evgp_rcs_console.commands import Given

FEW = 4
"""Maximum number of held karts that are shown with reasons; more are shown by number only."""


@dataclass(frozen=True)
class Asked:
    """
    What an official confirms before a command is sent.

    :param offered: the command's availability in this race.
    :param kart: the kart that the command is for; None if it is not for a single kart.
    """

    command: Kind
    race: Snapshot
    offered: Availability
    kart: KartSnapshot | None
    results: Standings | None

    @property
    def sentences(self) -> list[str]:
        """Return the warning against the command, if any, and the command's consequences."""
        warning = [texts.ASK_WARNING.format(warning=self.warning)] if self.warning else []
        return [*warning, *self.consequences]

    @property
    def essence(self) -> list[str]:
        """Return all sentences without the caution. If they change, it is another question."""
        return [texts.ASK_STATE.format(condition=self.condition), *self.sentences]

    def differs_from(self, asked: Asked) -> str:
        """Return what has changed since the official was asked."""
        now, before = self.essence, asked.essence
        new = [each for each in now if each not in before]
        return ' '.join(new or [f'No longer true: {each}' for each in before if each not in now])

    @property
    def condition(self) -> str:
        """Return what an official confirms with YES."""
        command, statement, kart = self.command, self.offered.statement, self.kart
        if command is CommandKind.OPEN_TRACK and self.race.track.msr_used:
            by_msr = 'the MSR is on, every kart is standing still, and teams may go onto the track'
            return f'{statement}; {by_msr}' if statement else by_msr
        if statement:
            return statement
        if (confirmed := CATALOGUE[command].condition) and (kart or '{kart}' not in confirmed):
            return confirmed.format(kart=kart)
        return f'{CATALOGUE[command].label} is right'

    @property
    def warning(self) -> str:
        """
        Return why an official should not confirm the command; empty if no reason is known.

        A race under way is normal and causes no warning.
        """
        command, race, track = self.command, self.race, self.race.track
        if command in (CommandKind.IN_GARAGE, CommandKind.KART_IN_GARAGE, CommandKind.OPEN_TRACK):
            settled = track.settled_by is command  # the command itself removes the reason
            barred = not (track.allowed or settled) and race.state not in texts.UNDER_WAY
            why = track.reason if barred else texts.against_humans(race)
            if why:
                return f'humans must stay off the track now: {why}'
            doubtful = texts.in_doubt(race)
            if doubtful and command is not CommandKind.KART_IN_GARAGE:
                opens = command is CommandKind.OPEN_TRACK
                then = 'so leave the MSR on' if opens else 'unless switched off'
                return f'only the MSR can stop {doubtful}, {then}'
            if race.nobody_is_heard:
                return f'no kart is connected; {texts.HUMANS_UNKNOWN_REASON}'
        return ''

    @property
    def caution(self) -> str:
        """Return what else an official should know. If it changes, the question stays the same."""
        command, race, results = self.command, self.race, self.results
        if command is CommandKind.GREEN_GREEN:
            return f'{texts.can_stop(race)}.'
        if command is not CommandKind.GRID_ACTIVE:
            return ''
        concerned = [kart for kart in race.karts if kart.number in self.offered.karts]
        told, poor = [], numbered(kart for kart in concerned if kart.poor_lately)
        if poor:
            late = 'a stop may arrive late'
            told.append(f'The link to {poor} has been poor in the last minute: {late}.')
        run = results.races if results and race.state is not RaceState.GRID_ACTIVE else ()
        for each in run:
            if each.counts and each.heat == race.heat:
                at = time_of_day(each.stamp)[:5]
                again = 'This run will count instead'
                told.append(f'{race.heat} has already been run, at {at}. {again}.')
        return ' '.join(told)

    @functools.cached_property
    def effects(self) -> Effects:
        command, race, kart = self.command, self.race, self.kart
        sends = CATALOGUE[command].sends
        if sends is None:
            sent = []
        elif kart is not None:
            sent = [kart]
        elif command is CommandKind.RECORD_MSR:
            sent = [*race.karts]
        else:
            # A repeated GRID_ACTIVE is not sent again to the karts that already have it.
            offered = [each for each in race.karts if each.number in self.offered.karts]
            sent = [each for each in offered if each.sent is not sends]
        others = [each for each in race.karts if each not in sent]
        return Effects(
            now=tuple(each for each in sent if each.connected),
            later=tuple(each for each in sent if not each.connected),
            held=tuple(each for each in others if each.hold is not None),
            rest=tuple(each for each in others if each.hold is None),
        )

    @property
    def consequences(self) -> list[str]:
        """Return sentences that say what the command would do to each kart on the roster."""
        command, race, kart = self.command, self.race, self.kart
        entry, does = CATALOGUE[command], self.effects
        said = [entry.note] if entry.note else []
        if command is CommandKind.KART_UNDO_FINISH and kart is not None:
            sent = 'has been sent' if kart.flag_at is None else 'has not been sent yet'
            said.append(f'Its RED FLAG {sent}.')
        if command is CommandKind.RECORD_MSR and race.banner:
            said.append(f'{race.banner}: the instructor uses the MSR for you. Say "MSR" first.')
        if 'hold' in entry.takes and kart is not None and kart.hold is not None:
            said.append(f'Releases {_held(kart)}.')
        if entry.sends is not None and (does.now or kart is None):
            end = entry.then[len(does.now) > 1] if does.now else ''
            sends = f'Sends {STATES[entry.sends]} now to {_kart_list(does.now)}.'
            said.append(f'{sends} {end}'.rstrip())
        if does.later:
            when = 'when it connects' if len(does.later) == 1 else 'when they connect'
            said.append(f'Sends {STATES[entry.sends]} to {numbered(does.later)} {when}.')
        if kart is not None:
            if 'hold' in entry.takes and kart.in_race and race.state is not RaceState.IN_GARAGE:
                said.append('Takes the kart out of the race.')
            if 'hold' in entry.takes and (why := texts.under_way(race)):
                said.append(f'Humans must stay off the track: {why}.')
            return said
        if does.held:
            stays = 'Stays' if len(does.held) == 1 else 'Stay'
            few = does.held if len(does.held) <= FEW else ()
            who = '; '.join(map(_held, few)) or numbered(does.held)
            said.append(f'{stays} held: {who}.')
        if does.rest and entry.sends is not None:
            stays = 'Stays as it is' if len(does.rest) == 1 else 'Stay as they are'
            said.append(f'{stays}: {numbered(does.rest)}.')
        if command is CommandKind.GRID_ACTIVE and any(each.place for each in race.karts):
            said.append('Clears the places of the last race.')
        return said


@dataclass(frozen=True)
class Effects:
    """
    The effects of a command. Each kart on the roster is in one of these groups.

    :param now: karts that are sent the command's state at once.
    :param later: karts without a connection, which are sent the state when they connect.
    :param held: karts to which the command sends nothing, and which remain held.
    :param rest: the other karts to which the command sends nothing.
    """

    now: tuple[KartSnapshot, ...]
    later: tuple[KartSnapshot, ...]
    held: tuple[KartSnapshot, ...]
    rest: tuple[KartSnapshot, ...]


def _kart_list(karts: tuple[KartSnapshot, ...]) -> str:
    if len(karts) > 1:
        return f'{len(karts)} karts: {", ".join(str(kart.number) for kart in karts)}'
    return numbered(karts) or 'no kart'


def _held(kart: KartSnapshot) -> str:
    return f'{kart}: {STATES[kart.hold]}, {kart.hold_reason}'


def also(following: Sequence[Given]) -> str:
    """Return what YES, AND ALSO confirms with IN GARAGE: an open track, or karts made safe."""
    if following[0].command is CommandKind.OPEN_TRACK:
        why = NO_RACE_ANYWHERE if following[0].stated else 'they may go onto the track'
        return f'OPEN TRACK to teams: {why}'
    return f'GARAGE: {numbered(each.kart for each in following)} made safe by hand'
