# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The texts that the console writes itself: long ones, shared ones, and sentences about a race.

Race control's own sentences (reasons, answers, alerts, events) are shown as they arrive. The
labels of the commands are in the catalogue.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import math

from evgp_node.results import Act
from evgp_protocol.states import RaceState
from evgp_rcs.rules.snapshot import Snapshot
from evgp_rcs.words import numbered, STATES
from evgp_rcs_console.catalogue import CATALOGUE, Kind
from evgp_rcs_console.commands import Given

TITLE = 'EVGP race control'
BANNER = '=== {banner} ==='

HOW_TO_BEGIN = (
    '1  List the karts in a roster. Start race control: make run ROSTER=… Each kart gets a row.',
    '2  JOIN adds one kart to the race. HEAT adds all the karts in a heat.',
    '3  Press GRID ACTIVE once the track is clear, and GREEN GREEN once all karts are ready.',
)
"""Shown instead of the karts while the roster is empty."""

NOT_LINKED = '✗ NO LINK'
MAY_MOVE = 'may be moving'
MSR_STOPS_IT = 'only the MSR can stop it: make it safe once the track is open'
HELD = 'held: {reason}'
LAST_LAP_DONE = 'last lap done: FINISH'

TRACK_OPEN = '✓ TRACK OPEN'
TRACK_CLOSED = '✗ TRACK CLOSED'
TRACK_CLOSED_MSR = '✗ TRACK CLOSED, MSR IN USE'
TRACK_OPEN_MSR = '✓ TRACK OPEN, MSR IN USE'
KEEP_OFF = '✗ KEEP OFF THE TRACK'
CLEAR_TRACK = '✗ NOT SAFE: CLEAR THE TRACK'
UNHEARD_CLOSED = '✗ TRACK CLOSED, NO KART CONNECTED'
UNHEARD_OPEN = '? TRACK OPEN, NO KART CONNECTED'
HUMANS_UNKNOWN_REASON = 'race control cannot tell what karts are doing: check each one'

REFUSED = '✗ '

GONE = 'RACE CONTROL IS GONE'
NOT_YET = 'NO RACE CONTROL YET'
USE_MSR = 'USE THE MSR'
ENDED = 'RACE CONTROL HAS ENDED'
GONE_REASON = 'race control is gone'
NOT_YET_REASON = 'race control has not been found yet'
FAILED = 'RACE CONTROL HAS FAILED'
TWO = 'TWO RACE CONTROLS'
TWO_ADVICE = 'ALL KILL, THEN SHUT ONE DOWN'
KEYS_OFF_LARGE = 'KEYS OFF'

NOT_ALLOWED = (
    'ROS does not allow this program to command race control. With SROS2, use the enclave '
    '/officials; the enclave /watchers allows only rcs_ctl watch. ({error})'
)
ANSWER_NO = 'Nothing was sent: the question has changed. Press N and start again.'

ASK_STATE = 'I state: {condition}.'
ASK_WARNING = 'Warning: {warning}.'

ORDER_OF_FINISH, RESULTS = 'Order of FINISH', 'Results'
NO_TIMING = 'no timing'
NO_TIMING_REASON = (
    "no timing, so the lap is unknown. For FINISH, type the kart's number, then press Ctrl+E"
)

NOT_KEPT = 'Your choice was not saved for the next start: {error}'


def left(seconds: float) -> int:
    """Return a countdown in whole seconds, rounded up so that it never ends too soon."""
    return max(1, math.ceil(seconds))


def without_teams(text: str, teams: Mapping[int, str]) -> str:
    """Return a sentence from race control without the teams' names."""
    for number, team in teams.items():
        text = text.replace(f' {number} ({team})', f' {number}')
    return text


def command_name(command: Kind, kart: int = 0) -> str:
    return f'{CATALOGUE[command].label} kart {kart}' if kart else CATALOGUE[command].label


def full_name(given: Given) -> str:
    name = command_name(given.command, given.kart)
    return f'{name} {given.heat}' if given.heat else name


def in_doubt(race: Snapshot) -> str:
    """Return the karts that may be moving although they should not be; empty if there are none."""
    return numbered([kart for kart in race.karts if kart.in_doubt])


def against_humans(race: Snapshot) -> str:
    """Return what keeps humans off the track in any state of the race; empty if nothing does."""
    if race.msr_alerts:
        return race.msr_alerts[0].text
    if race.track.msr_used:
        return ''
    doubtful = in_doubt(race)
    return f'{doubtful} may be moving' if doubtful else ''


def under_way(race: Snapshot) -> str:
    """Return a warning if the race is under way or a kart is being sent onto the track."""
    if race.state in UNDER_WAY:
        return f'the race is in {STATES[race.state]}'
    sent = [kart for kart in race.karts if kart.connected and kart.sent in UNDER_WAY]
    return f'{sent[0]} is being sent {STATES[sent[0].sent]}' if sent else ''


def not_there(command: Kind, name: str) -> str:
    who = 'the timekeeper' if isinstance(command, Act) else 'race control'
    return f'{name} was not sent: {who} was not found.'


def no_answer(given: Given, waited: float, details: str = '', reason: str = '') -> str:
    """
    Return a message that a command is unanswered, with what the official must do now.

    :param waited: time since the command was given, in seconds.
    :param details: what else is known about this wait; empty if nothing.
    :param reason: why race control has not accepted the command so far; empty if unknown.
    """
    within = f'no answer within {round(waited, 1):g} s{f" ({details})" if details else ""}'
    where = 'results' if isinstance(given.command, Act) else 'race'
    check = f'Check the {where} to see whether it took effect.'
    advice = 'USE THE MSR.' if CATALOGUE[given.command].stop else check
    because = f' Race control has not accepted it: {reason}' if reason else ''
    return f'{full_name(given)}: {within}. {advice}{because}'


def can_stop(race: Snapshot) -> str:
    """Return how many officials' programs can stop the race, and which ones."""
    count, who = race.able_to_stop, race.who_can_stop
    s = '' if count == 1 else 's'
    nobody = 'No official can stop the race: no screen or button reports that it is working'
    return f'{count} official{s} can stop the race: {who}' if count else nobody


UNDER_WAY = (RaceState.GRID_ACTIVE, RaceState.GREEN_GREEN)
"""The states of the race in which humans must always stay off the track."""


def missing(race: Snapshot) -> str:
    """
    Return the karts in the race that have not obeyed their order yet; empty if all have.

    Once the MSR was used, the race waits for no kart that has no connection.
    """
    racing = [kart for kart in race.karts if kart.in_race and kart.sent is not RaceState.IN_GARAGE]
    late = [
        kart
        for kart in racing
        if (not kart.acknowledged or kart.in_doubt) and (kart.connected or not race.track.msr_used)
    ]
    if not late:
        return ''
    return f'waiting for {", ".join(str(kart.number) for kart in late)}'


def heat_in_race(race: Snapshot) -> str:
    racing = [kart for kart in race.karts if kart.in_race]
    names = [race.heat_in_race.name] if race.heat_in_race else []
    return ' · '.join([*names, count(racing)]) if racing else ''


def count(karts: Sequence[object]) -> str:
    return '1 kart' if len(karts) == 1 else f'{len(karts) or "no"} karts'
