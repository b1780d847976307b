# Copyright 2026 EVGP race control contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""
Faults put into the rules of the race on purpose: the oracle's search must find every one.

This is the test of the oracle. A property that no fault can break proves nothing.
"""

from __future__ import annotations

from pathlib import Path
from types import ModuleType
from typing import Any

from evgp_rcs import race
import pytest
import race_oracle as oracle
from rig.faults import Fault, module_with

pytestmark = [pytest.mark.usefixtures('others_first'), pytest.mark.timeout(900)]

REQUIRED = {'require_inspection': True}
AT_ONCE = {'settle': 0.0}
ALL_OF_ONE = oracle.KART_COMMANDS

# Each small world with the number of its states that are searched. Each fault is found in one of
# them well before.
WORLDS: dict[str, tuple[int, dict[str, Any]]] = {
    'one outside': (150, {'racing': 1, 'outside': 1}),
    'green': (150, {'racing': 1, 'outside': 0, 'begin': 'green'}),
    'grid': (150, {'racing': 1, 'outside': 1, 'begin': 'grid', 'times': AT_ONCE}),
    'around': (
        320,
        {'racing': 1, 'outside': 0, 'begin': 'grid', 'around': True, 'times': AT_ONCE},
    ),
    'crash': (150, {'racing': 1, 'outside': 0, 'begin': 'crash'}),
    'unknown': (150, {'racing': 1, 'outside': 0, 'begin': 'unknown'}),
    'unknown outside': (
        150,
        {'racing': 0, 'outside': 1, 'begin': 'unknown', 'times': {'settle': 2.0}},
    ),
    'waits': (
        150,
        {'racing': 1, 'outside': 1, 'begin': 'grid', 'waits': True, 'times': AT_ONCE},
    ),
    'a start alone': (
        300,
        {
            'racing': 1,
            'outside': 0,
            'begin': 'grid',
            'waits': True,
            'track': False,
            'without': ALL_OF_ONE,
        },
    ),
    'waits around': (
        150,
        {'racing': 1, 'outside': 0, 'begin': 'grid', 'waits': True, 'around': True},
    ),
    'held up': (
        200,
        {
            'racing': 0,
            'outside': 1,
            'begin': 'unknown',
            'waits': True,
            'without': ALL_OF_ONE,
            'times': {'settle': 2.0},
        },
    ),
    'two in green': (300, {'racing': 2, 'outside': 0, 'begin': 'green'}),
    'two on the grid': (100, {'racing': 2, 'outside': 0, 'begin': 'grid'}),
    'two': (150, {'racing': 2, 'outside': 0}),
    'uninspected outside': (
        60,
        {'racing': 1, 'outside': 1, 'times': REQUIRED, 'uninspected': (2,)},
    ),
    'uninspected': (60, {'racing': 1, 'outside': 1, 'times': REQUIRED, 'uninspected': (1,)}),
}

# The nearest states of all worlds come first: there most faults are found.
NEAREST = (16, 60)

# The faults that these do not show, and the world that does: there the search for them begins.
FAR = {
    'the race goes over when the first kart has finished': 'two in green',
    'GREEN_GREEN counts the acknowledgement of a red': 'around',
    'a finish that is undone ends the hold of the kart': 'green',
    'the places are gone with IN_GARAGE': 'green',
    'a heat that takes a kart out forgets that it may be moving': 'two',
    'later places stay when a finish is undone': 'two in green',
    'a start that waited while race control was held up goes out': 'waits',
    'a start that was stopped meanwhile goes out when it is on the disk': 'waits',
    'in a pause it is told that the race may go home now': 'waits',
    'a stop cuts the pause short that a delay began': 'waits',
    'the grid forms with a kart that was seen to move': 'around',
    'a kart is released while another race control runs': 'around',
    'a finish is never followed by RED_FLAG': 'green',
    'a finish that is undone sends the kart on': 'green',
    'a finish is undone when the results are out': 'green',
    'the race is said to be on when every kart stands': 'green',
    'a kart that drops in RED_FLAG is not held': 'green',
    'a kart without an inspection may start': 'uninspected',
    'a kart without an inspection may join': 'uninspected outside',
    'a heat may have a kart without an inspection': 'uninspected outside',
    'the statement answers for a kart that was known in doubt': 'crash',
    'the statement answers for a kart that was held alone': 'unknown',
    'after a restart nobody answers for a kart that never comes': 'unknown',
    'IN_GARAGE after a restart does not wait for a connected kart outside': 'unknown outside',
    'a finish that is undone keeps its RED_FLAG': 'green',
    'a finish that is undone cancels the RED_FLAG of another kart': 'two in green',
    'a finish that is undone puts the RED_FLAG of who moves up off': 'two in green',
    'a finish that is undone lifts the hold of a stop that came meanwhile': 'green',
    'GREEN_GREEN after another command than GRID_ACTIVE': 'grid',
    'GREEN_GREEN while a kart outside the race is lost on the grid': 'two on the grid',
    'GREEN_GREEN while a kart that left the grid has only just acknowledged': 'two on the grid',
    'a record that fails while a start waits does not stop it': 'waits around',
    'a kart stands while race control is held up and hears nothing': 'held up',
    'every word said again begins the time to stand again': 'unknown outside',
    'the time to stand counts from the order': 'green',
    'a new order lets the time to stand run on': 'green',
    'GREEN_GREEN while a kart on the grid may be moving': 'around',
    'a start goes out to a later grid': 'a start alone',
    'GRID_ACTIVE is taken right behind the closing of the track': 'waits',
    'closing a closed track begins a pause': 'waits',
}


FAULTS = {
    'what was said before the command is an acknowledgement': Fault(
        'counts = state is kart.sent and serial == kart.serial',
        'counts = state is kart.sent',
        ('ack-old',),
    ),
    'anything said under the present serial is an acknowledgement': Fault(
        'counts = state is kart.sent and serial == kart.serial',
        'counts = serial == kart.serial',
        ('ack-old',),
    ),
    'an acknowledgement of GREEN_GREEN is not heard': Fault(
        'counts = state is kart.sent and serial == kart.serial',
        'counts = state is kart.sent is not GREEN_GREEN and serial == kart.serial',
        ('ack-deaf',),
    ),
    'no acknowledgement is heard': Fault(
        'counts = state is kart.sent and serial == kart.serial',
        'counts = state is kart.sent and serial > kart.serial',
        ('ack-deaf', 'stuck'),
    ),
    'time acknowledges': Fault(
        '            if kart.finish_due is not None and now >= kart.finish_due:\n',
        '            kart.acknowledged = kart.connected\n'
        '            if kart.finish_due is not None and now >= kart.finish_due:\n',
        ('ack-from-nothing',),
    ),
    'an order to a kart that is not connected': Fault(
        '        if kart.connected:\n            if state is GRID_ACTIVE:\n',
        '        if True:\n            if state is GRID_ACTIVE:\n',
        ('order-wrong', 'restart'),
    ),
    'a stop is announced as allowed, and refused': Fault(
        '        if refusal:\n            return refusal\n',
        '        if command.kind is CommandKind.ALL_KILL and self.state is IN_GARAGE:\n'
        "            refusal = 'nothing is under way'\n"
        '        if refusal:\n            return refusal\n',
        ('stop-refused',),
    ),
    'an acknowledgement survives the connection': Fault(
        '        kart.connected = False\n        kart.acknowledged = False\n',
        '        kart.connected = False\n',
        ('ack-survives',),
    ),
    'a new connection goes on under the old serial': Fault(
        '        kart.serial += 1\n',
        '        kart.serial += changed\n',
        ('order-serial',),
    ),
    'a reconnection lets a hold be forgotten': Fault(
        '            kart.lost_since = None\n        kart.reported = None\n',
        '            kart.lost_since = None\n        kart.hold = None\n',
        ('hold-forgotten', 'red-loosened'),
    ),
    'a kart that drops in RED_FLAG is not held': Fault(
        'if under_way and self.state is not GRID_ACTIVE:',
        'if under_way and self.state not in (GRID_ACTIVE, RED_FLAG):',
        ('drop-not-held',),
    ),
    'a kart that drops is held in RED_FLAG only': Fault(
        "self._hold(kart, RED_RED, f'lost",
        "self._hold(kart, RED_FLAG, f'lost",
        ('drop-not-held',),
    ),
    'a kart that is replaced while connected does not count as dropped': Fault(
        "            self._drop(kart, 'a new connection from its address took its place', now)\n",
        '            pass\n',
        ('drop-not-held', 'alerts'),
    ),
    'RED_FLAG loosens RED_RED': Fault(
        'self._go(stricter(self.state, RED_FLAG), now)',
        'self._go(RED_FLAG, now)',
        ('stop-loosens', 'stop-idempotent', 'red-loosened'),
    ),
    'a later hold loosens an earlier one': Fault(
        'if kart.hold is None or hold.strictness > kart.hold.strictness:',
        'if kart.hold is not hold:',
        ('stop-loosens', 'stop-idempotent', 'hold-forgotten'),
    ),
    'a stop is refused to a kart outside the race': Fault(
        'CommandKind.KART_RED_RED: Rule(Race._stop_kart),',
        'CommandKind.KART_RED_RED: Rule(Race._stop_kart, Race._no_release),',
        ('availability', 'stop-refused'),
    ),
    'a stop that is in force is sent anew and its acknowledgement falls': Fault(
        '        if not (changed or anew):\n',
        '        if not (changed or anew or state is RED_RED):\n',
        ('stop-idempotent',),
    ),
    'a kart is not told at once': Fault(
        'kart.hold_reason = reason + before\n        self._redirect(kart, now)\n',
        'kart.hold_reason = reason + before\n',
        ('stop-at-once', 'sent-wrong', 'restart'),
    ),
    'ALL_KILL forgets the karts outside the race': Fault(
        '        for each in self.karts.values():\n'
        '            self._hold(each, RED_RED, cause, now)\n',
        '        for each in self.racing():\n            self._hold(each, RED_RED, cause, now)\n',
        ('stop-at-once',),
    ),
    'GREEN_GREEN after another command than GRID_ACTIVE': Fault(
        'self.grid_was_last = command.kind is',
        'self.grid_was_last |= command.kind is',
        ('available-from', 'availability', 'green-needs-grid'),
    ),
    'GREEN_GREEN while a kart is not connected': Fault(
        'if not (each.connected and each.acknowledged)',
        'if each.connected and not each.acknowledged',
        ('availability', 'green-needs-acks'),
    ),
    'GREEN_GREEN while a kart has not acknowledged': Fault(
        'if not (each.connected and each.acknowledged)',
        'if not each.connected',
        ('availability', 'green-needs-acks', 'refusal-silent'),
    ),
    'GRID_ACTIVE while a kart is held': Fault(
        "        held = _held(racing)\n        if held:\n            return f'release",
        '        held = _held(each for each in racing if each.hold is RED_FLAG)\n'
        '        if held:\n'
        "            return f'release",
        ('availability',),
    ),
    'GRID_ACTIVE without the statement that the track is clear': Fault(
        "lambda race, command: 'the track is clear of humans',",
        "lambda race, command: '',",
        ('statement',),
    ),
    'joining the race releases a held kart': Fault(
        '        kart.in_race = True\n',
        '        kart.in_race = True\n        self._unhold(kart)\n',
        ('membership-loosens', 'hold-forgotten'),
    ),
    'a kart that is taken out on the grid is not held': Fault(
        "            self._hold(kart, RED_RED, 'taken out of the race on the grid', now)\n",
        '            self._redirect(kart, now)\n',
        ('effect', 'sent-wrong'),
    ),
    'a kart leaves the race while it drives': Fault(
        'if self.state not in (IN_GARAGE, GRID_ACTIVE):',
        'if self.state is RED_RED:',
        ('availability',),
    ),
    'IN_GARAGE while a kart is silent': Fault(
        'for each in self._waited_for() if not each.answered\n',
        'for each in self._waited_for() if not (each.answered or each.hold)\n',
        ('availability',),
    ),
    'IN_GARAGE releases a kart that never acknowledged its red': Fault(
        'or (each.stands and (each.in_race or not each.held_alone))',
        'or each.in_race\n                or not each.held_alone',
        ('hold-forgotten', 'red-loosened', 'as-seen', 'stuck'),
    ),
    'IN_GARAGE leaves the use of the MSR in force for the next race': Fault(
        '        self.over = False\n        self.msr_used = False\n        self.restarted',
        '        self.over = False\n        self.restarted',
        ('effect',),
    ),
    'a release without the statement that a silent kart was made safe': Fault(
        "return '' if kart.stands else f'{kart} was made safe by hand'",
        "return ''",
        ('statement',),
    ),
    'a kart released during a race goes on with the race': Fault(
        'out = kart.in_race and self.state is not IN_GARAGE',
        'out = kart.in_race and self.state is RED_RED',
        ('effect', 'sent-wrong', 'red-to-green', 'green-only-by-command'),
    ),
    'a finish stops the kart on the finish line': Fault(
        'if kart.finish_due is not None and now >= kart.finish_due:',
        'if kart.finish_due is not None:',
        ('sent-wrong', 'effect'),
    ),
    'a finish is never followed by RED_FLAG': Fault(
        'self._hold(kart, RED_FLAG, MARKED_AS_FINISHED, now)',
        'pass',
        (
            'sent-wrong',
            'finish-put-off',
        ),
    ),
    'every place has the delay of the first': Fault(
        'min(place, len(self.finish_delays)) - 1',
        '0',
        ('effect',),
    ),
    'a kart finishes twice': Fault(
        '        if kart.place:\n',
        '        if kart.place > 1:\n',
        ('availability',),
    ),
    'a finish that is undone ends the hold of the kart': Fault(
        '        place, kart.place = kart.place, 0\n',
        '        place, kart.place = kart.place, 0\n'
        '        if kart.finish_due is None:\n'
        '            self._unhold(kart)\n'
        '            self._redirect(kart, now)\n',
        ('red-loosened', 'hold-forgotten'),
    ),
    'a finish that is undone sends the kart on': Fault(
        '        place, kart.place = kart.place, 0\n',
        '        place, kart.place = kart.place, 0\n'
        '        if self.state is RED_FLAG:\n'
        '            self._go(GREEN_GREEN, now)\n',
        ('green-needs-grid', 'red-loosened', 'green-only-by-command'),
    ),
    'later places stay when a finish is undone': Fault(
        '            each.place -= 1\n',
        '            pass\n',
        ('effect',),
    ),
    'a place that was taken back counts for the next one': Fault(
        '        self.places_given -= 1\n',
        '',
        ('effect',),
    ),
    'a finish is undone when the results are out': Fault(
        '        if kart.number not in self.starters:\n',
        '        if False:\n',
        ('availability',),
    ),
    'a finish is undone without the statement that the kart has not finished': Fault(
        "lambda race, command: f'{race.karts[command.kart]} has not finished',",
        "lambda race, command: '',",
        ('statement',),
    ),
    'the race goes over while a finish is outstanding': Fault(
        'if not kart.place or kart.finish_due is not None:',
        'if not kart.place:',
        ('sent-wrong', 'effect'),
    ),
    'the race goes over when the first kart has finished': Fault(
        'if not kart.place or kart.finish_due is not None:\n                return None\n',
        'if not kart.place or kart.finish_due is not None:\n                continue\n',
        ('sent-wrong', 'effect'),
    ),
    'humans may be on the track while the race drives': Fault(
        'if self.state in (GRID_ACTIVE, GREEN_GREEN):',
        'if self.state is GRID_ACTIVE:',
        ('track-access', 'availability'),
    ),
    'the track stays open when the grid forms': Fault(
        '        if self.track_open:\n            return',
        '        if self.has_rival:\n            return',
        ('availability', 'track-open-in-motion'),
    ),
    'a kart lost in motion lets humans on the track': Fault(
        '        if kart.may_be_moving:\n'
        "            return f'{kart} was lost in motion: use the MSR'\n",
        '',
        ('track-access', 'availability'),
    ),
    'a kart that was told to go counts as standing': Fault(
        '                # Told to go, or told to stop and it has not said yet '
        'that it did.\n'
        '                kart.doubt = Doubt.MOVING\n',
        '                if state is not GREEN_GREEN:\n'
        '                    kart.doubt = Doubt.MOVING\n',
        ('doubt-unnoticed', 'effect'),
    ),
    'a refused command takes GREEN_GREEN away': Fault(
        "            answer = Answer(False, f'{command.kind.value} refused: {refusal}.')\n",
        "            answer = Answer(False, f'{command.kind.value} refused: {refusal}.')\n"
        '            self.grid_was_last = False\n',
        ('refused-changes',),
    ),
    'a refusal does not name the kart': Fault(
        "f'{each}: {self._silence(each)}'\n            for each in racing\n",
        "f'{self._silence(each)}'\n            for each in racing\n",
        ('refusal-silent',),
    ),
    'looking at alerts acts': Fault(
        '        alerts = []\n        for kind, kart, since, text in self._current_alerts(now):\n',
        '        alerts = []\n        self.track_open = False\n'
        '        for kind, kart, since, text in self._current_alerts(now):\n',
        ('alerts-act',),
    ),
    'a lost kart raises no alert': Fault(
        'if (under_way or kart.doubt) and kart.lost_since is None:',
        'if (under_way and kart.may_be_moving) and kart.lost_since is None:',
        ('alerts',),
    ),
    'a silent kart in RED_FLAG raises no alert': Fault(
        'self.times.flag_alert)',
        'self.times.ready_alert + 9.0)',
        ('alerts',),
    ),
    'GREEN_GREEN is announced after another command': Fault(
        'obstacle = self._refusal(Command(following))',
        "obstacle = ''",
        ('false-news',),
    ),
    'the race is said to be on when every kart stands': Fault(
        'standing = [kart for kart in racing if kart.stopped]',
        'standing: list[Kart] = []',
        ('false-news',),
    ),
    'a kart connecting during a race is sent IN_GARAGE': Fault(
        '        state = self._commanded(kart)\n',
        '        state = IN_GARAGE if anew else self._commanded(kart)\n',
        ('sent-wrong', 'red-loosened', 'order-wrong', 'ack-deaf'),
    ),
    # ----- heats, places and results ---------------------------------------------------------
    'a heat leaves the others in the race': Fault(
        '            each.in_race = each.number in heat.karts\n',
        '            each.in_race = each.in_race or each.number in heat.karts\n',
        ('heat-halved',),
    ),
    'a heat releases the karts that it puts into the race': Fault(
        '            each.in_race = each.number in heat.karts\n',
        '            each.in_race = each.number in heat.karts\n'
        '            if each.in_race:\n'
        '                self._unhold(each)\n',
        ('membership-loosens', 'hold-forgotten'),
    ),
    'a heat that takes a kart out forgets that it may be moving': Fault(
        '            each.in_race = each.number in heat.karts\n',
        '            each.in_race = each.number in heat.karts\n'
        '            each.doubt = each.doubt if each.in_race else Doubt.NONE\n',
        ('doubt-forgotten',),
    ),
    'a heat is put into a race that is under way': Fault(
        "            return f'the race is in {self.state.value}; a heat is put into the "
        "race in IN_GARAGE'\n",
        '            pass\n',
        ('availability',),
    ),
    'a heat that the roster does not have empties the race': Fault(
        '        for heat in self.heats:\n            if heat.name == name:\n',
        "        if name == 'no such heat':\n"
        '            self.heats += (Heat(name, ()),)\n'
        '        for heat in self.heats:\n'
        '            if heat.name == name:\n',
        ('availability', 'heat-halved', 'effect'),
    ),
    'a heat that is not in the roster is refused without those that are': Fault(
        "        names = ', '.join(f'\"{heat.name}\"' for heat in self.heats)\n",
        "        names = 'others'\n",
        ('refusal-silent',),
    ),
    'the places are gone with IN_GARAGE': Fault(
        '            each.finish_due = None\n        self.over',
        '            each.finish_due = None\n            each.place = 0\n        self.over',
        (
            'results',
            'effect',
        ),
    ),
    'the results of a race that was stopped are never told': Fault(
        '        self._tell_results()  # of a race that was stopped and never declared over\n',
        '',
        ('results',),
    ),
    'the results are told again with every RACE_OVER': Fault(
        '        starters = [self.karts[number] for number in self.starters]\n'
        '        self.starters = ()\n',
        '        starters = [self.karts[number] for number in self.starters]\n',
        ('results',),
    ),
    'the results leave out who did not finish': Fault(
        'missing = [str(each) for each in starters if not each.place]',
        'missing = [str(each) for each in starters if not each.place and each.in_race]',
        ('results',),
    ),
    'a restart forgets that the results were never told': Fault(
        '        if memory.state in (GREEN_GREEN, RED_FLAG) or in_red:\n',
        '        if memory.state is RED_FLAG or in_red:\n',
        ('restart',),
    ),
    'a kart that is held is given a place': Fault(
        '        if kart.hold is not None:\n'
        "            return f'{kart} is held: {kart.hold_reason}'\n",
        '',
        ('availability',),
    ),
    # ----- doubt ---------------------------------------------------------------------------
    'an unanswered stop leaves no doubt': Fault(
        '                # Told to go, or told to stop and it has not said yet '
        'that it did.\n'
        '                kart.doubt = Doubt.MOVING\n',
        '                if state is GREEN_GREEN:\n'
        '                    kart.doubt = Doubt.MOVING\n',
        ('doubt-unnoticed', 'alarm-cleared'),
    ),
    'a kart told to form the grid leaves no doubt': Fault(
        '                kart.doubt = max(kart.doubt, Doubt.GRID)\n            elif state',
        '                pass\n            elif state',
        ('doubt-unnoticed',),
    ),
    'a lost connection ends the doubt': Fault(
        '        kart.connected = False\n        kart.acknowledged = False\n',
        '        kart.connected = kart.acknowledged = False\n        kart.doubt = Doubt.NONE\n',
        ('doubt-forgotten', 'drop-not-held', 'alerts'),
    ),
    'a kart that is back counts as standing': Fault(
        '        if not kart.may_be_moving:\n            kart.lost_since = None\n',
        '        kart.lost_since = None\n        kart.doubt = Doubt.NONE\n',
        ('doubt-forgotten', 'alarm-cleared', 'drop-not-held', 'alerts', 'settle'),
    ),
    'a kart that is back ends the alarm of its loss': Fault(
        '        if not kart.may_be_moving:\n            kart.lost_since = None\n',
        '        kart.lost_since = None\n',
        ('alarm-cleared', 'alerts'),
    ),
    'the alarm of a kart lost in motion is told of missing karts only': Fault(
        '                if kart.may_be_moving:\n                    yield AlertKind.LOST_IN',
        '                if kart.may_be_moving and not kart.connected:\n'
        '                    yield AlertKind.LOST_IN',
        ('alarm-cleared', 'alerts'),
    ),
    'a kart outside the race that drops with a stop unanswered raises no alert': Fault(
        'if (under_way or kart.doubt) and kart.lost_since is None:',
        'if under_way and kart.lost_since is None:',
        ('alarm-cleared', 'alerts'),
    ),
    'any acknowledgement ends the doubt': Fault(
        '            if state.is_red:\n'
        '                kart.settles_at = now + self.times.settle\n'
        '                self._settle(kart, now)\n',
        '            kart.settles_at = now + self.times.settle\n'
        '            self._settle(kart, now)\n',
        ('doubt-forgotten', 'effect'),
    ),
    'the acknowledgement of a stop leaves the doubt': Fault(
        '            if state.is_red:\n'
        '                kart.settles_at = now + self.times.settle\n',
        '            if state is RED_FLAG:\n'
        '                kart.settles_at = now + self.times.settle\n',
        ('effect', 'stuck'),
    ),
    'a kart that says GREEN_GREEN unasked is not seen': Fault(
        '        if state is GREEN_GREEN and kart.sent is not GREEN_GREEN:\n',
        '        if state is GREEN_GREEN and kart.sent is GRID_ACTIVE:\n',
        ('doubt-unnoticed',),
    ),
    'a kart seen to move and lost comes back to be tested on': Fault(
        '        elif kart.may_be_moving:\n            self._hold(kart, RED_RED, '
        "'lost its connection while it may have been moving', now)\n",
        '',
        ('drop-not-held',),
    ),
    'a kart lost on the grid lets humans on the track': Fault(
        '        if kart.doubt is Doubt.GRID:\n            return (',
        '        if kart.doubt is Doubt.GRID and kart.in_race and self.state is '
        'IN_GARAGE:\n'
        '            return (',
        ('track-access', 'availability'),
    ),
    'a kart in the garage that was seen to move lets humans on the track': Fault(
        "return f'{kart} may be moving: stop it with RED_RED' if kart.may_be_moving else ''",
        "return f'{kart} may be moving: stop it with RED_RED' if kart.hold else ''",
        ('track-access', 'availability', 'refusal-silent', 'restart'),
    ),
    'the grid forms with a kart that was seen to move': Fault(
        'moving = [each for each in racing if each.may_be_moving]',
        'moving = [each for each in racing if each.hold]',
        ('availability',),
    ),
    'GREEN_GREEN counts the acknowledgement of a red': Fault(
        "        held = _held(racing)\n        if held:\n            return f'bring",
        "        held = ''\n        if held:\n            return f'bring",
        ('availability', 'green-needs-acks', 'refusal-silent'),
    ),
    'IN_GARAGE does not wait for a lost kart': Fault(
        'or (kart.in_race and not (self.msr_used or self._is_answered_for(kart)))',
        'or (kart.in_race and False)',
        ('availability',),
    ),
    'IN_GARAGE waits for lost karts in spite of the MSR': Fault(
        'or (kart.in_race and not (self.msr_used or self._is_answered_for(kart)))',
        'or (kart.in_race and not self._is_answered_for(kart))',
        ('availability', 'stuck'),
    ),
    'IN_GARAGE after the grid forgets a kart that was lost there': Fault(
        'if each.may_be_moving or (each.doubt and not each.connected)',
        'if each.may_be_moving',
        ('availability',),
    ),
    'a release by hand leaves the doubt': Fault(
        '        self._unhold(kart)\n        self._end_doubt(kart)\n',
        '        self._unhold(kart)\n',
        ('effect', 'stuck'),
    ),
    # ----- a word taken back --------------------------------------------------------------
    'a kart that says another state stands by its acknowledgement': Fault(
        '        elif kart.acknowledged and state is not kart.sent:\n',
        '        elif False:\n',
        ('ack-stale',),
    ),
    'only what is heard under the present serial takes an acknowledgement back': Fault(
        '        elif kart.acknowledged and state is not kart.sent:\n',
        '        elif kart.acknowledged and state is not kart.sent and serial == kart.serial:\n',
        ('ack-stale',),
    ),
    'a kart that takes the acknowledgement of a stop back counts as standing': Fault(
        '            if kart.sent.is_red:\n                kart.doubt = Doubt.MOVING\n',
        '',
        ('doubt-unnoticed',),
    ),
    # ----- held alone ---------------------------------------------------------------------
    'IN_GARAGE releases a kart outside the race that was held alone': Fault(
        'or (each.stands and (each.in_race or not each.held_alone))',
        'or each.stands',
        ('alone-released', 'as-seen', 'stuck'),
    ),
    'ALL_KILL hides that a kart was held alone': Fault(
        '            self._hold(each, RED_RED, cause, now)\n',
        '            self._hold(each, RED_RED, cause, now)\n            each.held_alone = False\n',
        ('effect', 'stop-idempotent'),
    ),
    'a kart held by ALL_KILL already is not held alone': Fault(
        '        if not kart.held_alone:\n            kart.held_alone = True\n',
        '        if kart.hold_reason == reason:\n            kart.held_alone = True\n',
        ('effect',),
    ),
    # ----- what the official saw ------------------------------------------------------------
    'a start need not be as the official saw it': Fault(
        '        if concerned == command.karts:\n',
        '        if command.karts <= concerned:\n',
        ('as-seen',),
    ),
    'a kart is released whatever hold the official saw': Fault(
        '        if seen is kart.hold:\n',
        '        if seen or not kart.hold:\n',
        ('as-seen',),
    ),
    'a start is announced for all karts of the roster': Fault(
        '    def _started(self, command: Command) -> Iterable[Kart]:\n'
        '        return self.racing()\n',
        '    def _started(self, command: Command) -> Iterable[Kart]:\n'
        '        return self.karts.values()\n',
        ('as-seen',),
    ),
    'a difference is not named': Fault(
        "            phrases.append(f'you did not name {_numbers(concerned - command.karts)}')\n",
        "            phrases = ['it is for others']\n",
        ('refusal-silent',),
    ),
    # ----- around race control ---------------------------------------------------------------
    'a kart is released while another race control runs': Fault(
        '        if CATALOGUE[command.kind].loosens and self.has_rival:\n',
        '        if CATALOGUE[command.kind].loosens and self.has_rival and not command.kart:\n',
        ('availability', 'rival'),
    ),
    'a stop is refused while another race control runs': Fault(
        '        if CATALOGUE[command.kind].loosens and self.has_rival:\n',
        '        if self.has_rival:\n',
        ('availability', 'stop-refused'),
    ),
    'another race control raises no alert': Fault(
        '        if self.has_rival:\n            yield',
        '        if self.has_rival and self.record_fails:\n            yield',
        ('alerts',),
    ),
    'a race starts without a record': Fault(
        "        if not self.record_fails:\n            return ''\n",
        "        if True:\n            return ''\n",
        ('no-record', 'availability', 'start-answer', 'start-first', 'false-news'),
    ),
    'a failing record raises no alert': Fault(
        '        if self.record_fails:\n            yield',
        '        if self.record_fails and self.has_rival:\n            yield',
        ('alerts',),
    ),
    # ----- pauses ----------------------------------------------------------------------------
    'a release is taken right behind a stop': Fault(
        "            self._pause(now + self.times.pause, 'a stop was sent just now')\n",
        '            pass\n',
        ('effect', 'pause', 'available-from'),
    ),
    'a stop to one kart lets a release through': Fault(
        '        if CATALOGUE[command.kind].stop:\n            # A release',
        '        if CATALOGUE[command.kind].stop and not command.kart:\n            # A release',
        ('effect', 'pause', 'available-from'),
    ),
    'a release that came before a stop is taken when the pause is over': Fault(
        'self._paused(command.kind, came)',
        'self._paused(command.kind, max(came, self.paused_until))',
        ('pause',),
    ),
    'a pause refuses what came after its end': Fault(
        'if CATALOGUE[kind].loosens and came < self.paused_until:',
        'if CATALOGUE[kind].loosens and came <= self.paused_until:',
        ('availability', 'available-from'),
    ),
    'a pause refuses a stop': Fault(
        'if CATALOGUE[kind].loosens and came < self.paused_until:',
        'if came < self.paused_until:',
        ('stop-refused', 'availability', 'available-from'),
    ),
    'a pause lets one kart be released': Fault(
        'if CATALOGUE[kind].loosens and came < self.paused_until:',
        'if CATALOGUE[kind].loosens and kind is not CommandKind.KART_IN_GARAGE '
        'and came < self.paused_until:',
        ('pause', 'available-from'),
    ),
    'what was sent while race control was held up is taken': Fault(
        "        self._pause(now + pause, f'race control was held up",
        "        self._pause(now, f'race control was held up",
        ('pause', 'available-from', 'effect'),
    ),
    'a stop cuts the pause short that a delay began': Fault(
        '        if until > self.paused_until:\n',
        '        if True:\n',
        ('pause', 'available-from', 'effect'),
    ),
    'a pause is not announced': Fault(
        '        paused = self._paused(kind, now)\n',
        "        paused = ''\n",
        ('available-from',),
    ),
    'what the rules refuse is announced for the end of the pause': Fault(
        "            return Availability(kind, number, reason, '')\n",
        "            return Availability(kind, number, reason, '', (), self.paused_until)\n",
        ('available-from',),
    ),
    'in a pause it is told that the race may go home now': Fault(
        '        if self._paused(following, now):\n',
        '        if self._paused(following, now) and self.state is GRID_ACTIVE:\n',
        ('false-news',),
    ),
    # ----- a start that waits ------------------------------------------------------------------
    'karts start before it is on the disk': Fault(
        'if refusal or not CATALOGUE[command.kind].needs_journal:',
        'if refusal or self.record_fails or True:',
        ('start-first',),
    ),
    'a start that was withdrawn goes out': Fault(
        "    StartPhase.WITHDRAWN: 'it was withdrawn while it waited for the record',\n",
        '',
        ('start-first', 'green-needs-acks', 'green-needs-grid'),
    ),
    'a start that the disk did not take goes out': Fault(
        '        if phase == StartPhase.FAILED:\n            self.record_fails',
        '        if False:\n            self.record_fails',
        ('start-first', 'start-answer'),
    ),
    'a start waits for the disk for ever': Fault(
        'and now >= self.start.until:',
        'and now >= self.start.until + 9.0:',
        ('start-answer', 'start-first'),
    ),
    'a start that was stopped meanwhile goes out when it is on the disk': Fault(
        '        refusal = self._refusal_of(start.command, start.came)\n'
        '        refusal = refusal or WHY',
        "        refusal = '' if phase == StartPhase.WRITTEN else self.record_fails\n"
        '        refusal = refusal or WHY',
        (
            'green-needs-grid',
            'green-needs-acks',
            'start-first',
            'start-other-grid',
            'pause',
            'no-record',
        ),
    ),
    'a start that waited while race control was held up goes out': Fault(
        'self._refusal_of(start.command, start.came)',
        'self._refusal_of(start.command, now + 9.0)',
        ('pause',),
    ),
    'what was written for another start starts karts': Fault(
        'if self.start is None or self.start.number != number:',
        'if self.start is None or self.start.number < number:',
        ('start-answer', 'start-first'),
    ),
    'a second GREEN_GREEN takes the place of the one that waits': Fault(
        "        if self.start is not None:\n            return 'another",
        "        if False:\n            return 'another",
        ('availability',),
    ),
    'while a start waits a crash leaves the race on the grid': Fault(
        '        if self.start is not None:\n            return self.start.memory\n',
        '',
        ('start-memory',),
    ),
    'a start that is refused is waited for all the same': Fault(
        '        self.start = None\n        if phase',
        '        if phase == StartPhase.WRITTEN:\n            self.start = None\n        if phase',
        ('effect',),
    ),
    # ----- a restart -------------------------------------------------------------------------
    'after a restart the track may be opened without a word': Fault(
        '        self.restarted = True\n',
        '        self.restarted = False\n',
        ('restart',),
    ),
    'a restart forgets the karts that left the roster': Fault(
        'if not (before.in_race or before.held or before.doubt):',
        'if True:',
        ('restart',),
    ),
    'a restart does not name the karts that left the roster': Fault(
        '        for kart in gone:\n',
        '        for kart in ():\n',
        ('restart',),
    ),
    'a restart forgets a stop that was left unanswered': Fault(
        '            kart.doubt = before.doubt\n',
        '            kart.doubt = min(before.doubt, Doubt.GRID)\n',
        ('restart',),
    ),
    'a restart takes it that nobody was sent to the grid from IN_GARAGE': Fault(
        'if before.in_race and not final:',
        'if before.in_race and not final and memory.state is not IN_GARAGE:',
        ('restart',),
    ),
    'a restart forgets who was on the grid': Fault(
        '            kart.doubt = before.doubt\n',
        '            kart.doubt = Doubt.MOVING if before.doubt is Doubt.MOVING else Doubt.NONE\n',
        ('restart',),
    ),
    'a restart forgets who was held alone': Fault(
        '            kart.held_alone = before.held and before.held_alone\n',
        '',
        ('restart',),
    ),
    'a restart that knows nothing begins in IN_GARAGE': Fault(
        '        if memory is not None and final and memory.at_rest:\n',
        '        if memory is None or (final and memory.at_rest):\n',
        ('restart',),
    ),
    'a restart goes on where the race was': Fault(
        '        for kart in self.karts.values():\n'
        "            self._hold(kart, RED_RED, 'race control was restarted', now)\n",
        '',
        ('restart',),
    ),
    'what is on the disk before GREEN_GREEN does not say that karts will move': Fault(
        'doubt=Doubt.MOVING) if kart.in_race',
        'doubt=kart.doubt) if kart.in_race',
        ('restart',),
    ),
    'a kart without an inspection may join': Fault(
        "karts join in IN_GARAGE'\n        return self._uninspected([kart])",
        "karts join in IN_GARAGE'\n        return ''",
        ('uninspected', 'availability'),
    ),
    'a kart without an inspection may start': Fault(
        'return self._uninspected(racing) or self._no_record()',
        'return self._no_record()',
        ('uninspected', 'availability'),
    ),
    'a heat may have a kart without an inspection': Fault(
        'return self._uninspected(self.karts[number] for number in heat.karts)',
        "return ''",
        ('uninspected',),
    ),
    'the statement that the track is safe leaves the doubt of a restart': Fault(
        '        self.restarted = False\n        self._tell_results()',
        '        self._tell_results()',
        ('effect', 'stuck'),
    ),
    # ----- to stand, and a start with doubt, a record or people ------------------------------
    'an acknowledgement at once ends the doubt': Fault(
        '                kart.settles_at = now + self.times.settle\n',
        '                kart.settles_at = now\n',
        ('settle', 'effect'),
    ),
    'the time to stand counts from the order': Fault(
        '                kart.settles_at = now + self.times.settle\n',
        '                kart.settles_at = kart.sent_since + self.times.settle\n',
        ('settle', 'effect'),
    ),
    'the time to stand counts from when it is first looked at': Fault(
        '                kart.settles_at = now + self.times.settle\n',
        '                kart.settles_at = now + 2 * self.times.settle\n',
        ('effect',),
    ),
    'a word that was taken back ends the doubt later': Fault(
        '            kart.withdrawn = True\n            kart.settles_at = None\n',
        '            kart.withdrawn = True\n',
        ('settle', 'effect'),
    ),
    'a kart that is lost while it settles is taken to stand': Fault(
        '        kart.acknowledged = False\n'
        '        kart.settles_at = None\n'
        '        kart.reported = None\n',
        '        kart.acknowledged = False\n        kart.reported = None\n',
        ('settle', 'effect', 'doubt-forgotten'),
    ),
    'a new order lets the time to stand run on': Fault(
        '        kart.withdrawn = False\n        kart.settles_at = None\n',
        '        kart.withdrawn = False\n',
        ('settle', 'effect'),
    ),
    'a kart stands while race control is held up and hears nothing': Fault(
        '            kart.settles_at = now + self.times.settle\n        pause = max',
        '            kart.settles_at += 0.0\n        pause = max',
        ('settle', 'effect'),
    ),
    'every word said again begins the time to stand again': Fault(
        'if counts and not kart.acknowledged:',
        'if counts and (not kart.acknowledged or kart.settles_at is not None):',
        ('effect',),
    ),
    'the doubt never ends by standing': Fault(
        '            self._settle(kart, now)\n            if kart.finish_due',
        '            if kart.finish_due',
        ('effect', 'stuck'),
    ),
    'humans are allowed as soon as a kart has acknowledged': Fault(
        "        if kart.stands:\n            return ''\n        if kart.connected and",
        "        if kart.stopped:\n            return ''\n        if kart.connected and",
        ('track-access', 'availability', 'refusal-silent'),
    ),
    'IN_GARAGE goes out as soon as every kart has acknowledged': Fault(
        'return self.stands if self.sent.is_red else self.acknowledged',
        'return self.acknowledged',
        ('availability', 'false-news'),
    ),
    'IN_GARAGE releases a kart that has not stood yet': Fault(
        'or (each.stands and (each.in_race or not each.held_alone))',
        'or (each.stopped and (each.in_race or not each.held_alone))',
        ('as-seen', 'hold-forgotten', 'red-loosened'),
    ),
    'a kart that has only just acknowledged is released alone without a word': Fault(
        "return '' if kart.stands else f'{kart} was made safe by hand'",
        "return '' if kart.stopped else f'{kart} was made safe by hand'",
        ('statement',),
    ),
    'the alarm of a kart lost in motion ends with its acknowledgement': Fault(
        '                kart.settles_at = now + self.times.settle\n',
        '                kart.settles_at = now + self.times.settle\n'
        '                kart.lost_since = None\n',
        ('alerts',),
    ),
    'GREEN_GREEN while a kart taken off the grid has not answered': Fault(
        'if each.may_be_moving or (each.doubt and not each.in_race)',
        'if each.in_race and each.may_be_moving',
        ('availability',),
    ),
    'GREEN_GREEN while a kart outside the race is lost on the grid': Fault(
        'if each.may_be_moving or (each.doubt and not each.in_race)',
        'if each.may_be_moving',
        ('availability',),
    ),
    'GREEN_GREEN while a kart on the grid may be moving': Fault(
        'if each.may_be_moving or (each.doubt and not each.in_race)',
        'if each.doubt and not each.in_race',
        ('availability',),
    ),
    'GREEN_GREEN while a kart that left the grid has only just acknowledged': Fault(
        '            if each.may_be_moving or (each.doubt and not each.in_race)\n',
        '            if (each.may_be_moving or (each.doubt and not '
        'each.in_race)) and not each.stopped\n',
        ('availability',),
    ),
    'GREEN_GREEN does not name the kart in doubt': Fault(
        '            return _cut(doubtful)\n',
        "            return 'a kart may be moving'\n",
        ('refusal-silent',),
    ),
    'GREEN_GREEN without a record': Fault(
        "return 'another GREEN_GREEN is still waiting for the record'\n"
        '        return self._no_record()',
        "return 'another GREEN_GREEN is still waiting for the record'\n        return ''",
        ('availability', 'no-record'),
    ),
    'GRID_ACTIVE without a record': Fault(
        'return self._uninspected(racing) or self._no_record()',
        'return self._uninspected(racing)',
        ('availability',),
    ),
    'a record that fails while a start waits does not stop it': Fault(
        '        refusal = self._refusal_of(start.command, start.came)\n',
        '        trouble = self.record_fails\n'
        '        if phase == StartPhase.WRITTEN:\n'
        "            self.record_fails = ''\n"
        '        refusal = self._refusal_of(start.command, start.came)\n'
        '        self.record_fails = trouble\n',
        ('start-first', 'no-record'),
    ),
    'a record that was too slow counts as working': Fault(
        '            self.record_fails = self.record_fails or (\n',
        '            _ = self.record_fails or (\n',
        ('start-first', 'effect', 'start-answer'),
    ),
    'after a restart the track counts as closed': Fault(
        'self.track_open = memory is None or memory.track_open or not final',
        'self.track_open = False',
        ('restart',),
    ),
    'after a crash the track is as it was last known': Fault(
        'self.track_open = memory is None or memory.track_open or not final',
        'self.track_open = memory is None or memory.track_open',
        ('restart',),
    ),
    'a restart that knows nothing has the track closed': Fault(
        'self.track_open = memory is None or memory.track_open or not final',
        'self.track_open = memory is not None and (memory.track_open or not final)',
        ('restart',),
    ),
    'an orderly end forgets that the track was open': Fault(
        'return RaceMemory(self.state, karts, self.track_open, self.msr_used)',
        'return RaceMemory(self.state, karts, False, self.msr_used)',
        ('restart',),
    ),
    'a restart forgets that the MSR was used': Fault(
        '            self.msr_used = memory.msr_used\n',
        '',
        ('restart',),
    ),
    'a restart takes it that the MSR was used': Fault(
        '            self.msr_used = memory.msr_used\n',
        '            self.msr_used = memory.msr_used or memory.state is RED_RED\n',
        ('restart',),
    ),
    'a memory that is not final counts as home': Fault(
        '        if memory is not None and final and memory.at_rest:\n',
        '        if memory is not None and memory.at_rest:\n',
        ('restart',),
    ),
    'an orderly end in mid-race counts as home': Fault(
        '        if memory is not None and final and memory.at_rest:\n',
        '        if memory is not None and final and memory.state is not GREEN_GREEN:\n',
        ('restart',),
    ),
    'a kart in doubt does not keep a restart from going home': Fault(
        'kart.held or kart.doubt for kart in self.karts.values()',
        'kart.held for kart in self.karts.values()',
        ('restart',),
    ),
    'a restart does not hold the karts of which nothing is known': Fault(
        '        for kart in self.karts.values():\n'
        "            self._hold(kart, RED_RED, 'race control was restarted', now)\n",
        '        for kart in self.karts.values():\n'
        '            if memory is not None and kart.number in memory.karts:\n'
        "                self._hold(kart, RED_RED, 'race control was restarted', now)\n",
        ('restart',),
    ),
    'a kart that was lost before a restart raises no alarm': Fault(
        '            if kart.doubt:\n                kart.lost_since = now\n',
        '',
        ('alerts',),
    ),
    'the statement answers for a kart that was known in doubt': Fault(
        'return self.restarted and not (kart.connected or kart.doubt or kart.held_alone)',
        'return self.restarted and not (kart.connected or kart.held_alone)',
        ('availability', 'as-seen', 'hold-forgotten'),
    ),
    'the statement answers for a kart that was held alone': Fault(
        'return self.restarted and not (kart.connected or kart.doubt or kart.held_alone)',
        'return self.restarted and not (kart.connected or kart.doubt)',
        ('availability', 'as-seen', 'alone-released', 'hold-forgotten'),
    ),
    'the statement answers for absent karts without a restart': Fault(
        'return self.restarted and not (kart.connected or kart.doubt or kart.held_alone)',
        'return not (kart.connected or kart.doubt or kart.held_alone)',
        ('availability', 'as-seen', 'hold-forgotten'),
    ),
    'after a restart nobody answers for a kart that never comes': Fault(
        'return self.restarted and not (kart.connected or kart.doubt or kart.held_alone)',
        'return False',
        ('availability', 'as-seen', 'stuck'),
    ),
    'IN_GARAGE after a restart does not wait for a connected kart outside': Fault(
        '(kart.in_race or (self.restarted and kart.sent.is_red))',
        'kart.in_race',
        ('availability',),
    ),
    'IN_GARAGE always waits for connected karts outside the race': Fault(
        '(kart.in_race or (self.restarted and kart.sent.is_red))',
        '(kart.in_race or kart.sent.is_red)',
        ('availability', 'false-news'),
    ),
    'OPEN_TRACK after a restart before the statement': Fault(
        '        if self.restarted:\n            return False, (',
        '        if self.restarted and self.over:\n            return False, (',
        ('restart', 'track-access', 'availability'),
    ),
    'a finish that is undone keeps its RED_FLAG': Fault(
        '        kart.finish_due = None\n        if kart.sent is GREEN_GREEN:\n',
        '        if kart.sent is GREEN_GREEN:\n',
        ('effect', 'sent-wrong'),
    ),
    'a finish that is undone cancels the RED_FLAG of another kart': Fault(
        '        for each in moved_up:\n            each.place -= 1\n',
        '        for each in moved_up:\n'
        '            each.place -= 1\n'
        '            each.finish_due = None\n',
        ('finish-put-off',),
    ),
    'a finish that is undone puts the RED_FLAG of who moves up off': Fault(
        '        for each in moved_up:\n            each.place -= 1\n',
        '        for each in moved_up:\n'
        '            each.place -= 1\n'
        '            each.finish_due = now + 9.0\n',
        ('finish-put-off', 'effect'),
    ),
    'a finish that is undone lifts the hold of a stop that came meanwhile': Fault(
        '        kart.finish_due = None\n        if kart.sent is GREEN_GREEN:\n',
        '        if kart.finish_due is not None:\n'
        '            self._unhold(kart)\n'
        '            self._redirect(kart, now)\n'
        '        if kart.sent is GREEN_GREEN:\n',
        ('red-loosened', 'hold-forgotten'),
    ),
    'a kart that moves on the grid raises no alert': Fault(
        'if kart.connected and kart.may_be_moving and kart.sent in (IN_GARAGE, GRID_ACTIVE):',
        'if kart.connected and kart.may_be_moving and kart.sent is IN_GARAGE:',
        ('alerts',),
    ),
    'a kart that moves in the garage raises no alert': Fault(
        'if kart.connected and kart.may_be_moving and kart.sent in (IN_GARAGE, GRID_ACTIVE):',
        'if kart.connected and kart.may_be_moving and kart.sent is GRID_ACTIVE:',
        ('alerts',),
    ),
    'a kart that moves unasked and says it again is no alert': Fault(
        'if kart.connected and kart.may_be_moving and kart.sent in (IN_GARAGE, GRID_ACTIVE):',
        'if kart.connected and kart.may_be_moving and kart.sent in (IN_GARAGE, '
        'GRID_ACTIVE) and not kart.acknowledged:',
        ('alerts',),
    ),
    'a change of state does not say what caused it': Fault(
        'self.state_cause = why or self._cause()',
        'self.state_cause = why',
        ('cause',),
    ),
    'a change of state does not say who gave the command': Fault(
        'by.kind, by.official)',
        "by.kind, '')",
        ('cause',),
    ),
    'the cause does not name the official': Fault(
        "official = f' by {self._by.official}' if self._by.official else ''\n        return",
        "official = ''\n        return",
        ('cause',),
    ),
    'the cause is that of the last change': Fault(
        'self.state_cause = why or self._cause()',
        'self.state_cause = self.state_cause or why or self._cause()',
        ('cause',),
    ),
    'the MSR is asked for when it was used': Fault(
        'use_msr = kind in MSR_ALERTS and not self.msr_used',
        'use_msr = kind in MSR_ALERTS',
        ('use-msr',),
    ),
    'the MSR is not asked for when a kart is lost in motion': Fault(
        '        AlertKind.LOST_IN_MOTION,\n        AlertKind.TRACK_UNSAFE,\n    }',
        '        AlertKind.TRACK_UNSAFE,\n    }',
        ('use-msr',),
    ),
    'a track that officials opened is closed by a stop': Fault(
        '            self._hold(each, RED_RED, cause, now)\n',
        '            self._hold(each, RED_RED, cause, now)\n            self.track_open = False\n',
        ('effect', 'stop-idempotent'),
    ),
    'GRID_ACTIVE closes the track by itself': Fault(
        '        if self.track_open:\n'
        "            return 'the track is open to humans; close it first'\n",
        '        self.track_open = False\n',
        ('alerts-act', 'availability', 'effect', 'refused-changes'),
    ),
    'a start goes out to a later grid': Fault(
        '            self.start = self.start._replace(phase=StartPhase.OUTLIVED)\n',
        '            pass\n',
        ('start-other-grid',),
    ),
    'GRID_ACTIVE is taken right behind the closing of the track': Fault(
        "            self._pause(now + self.times.pause, 'the track was closed just now')\n",
        '            pass\n',
        ('pause', 'effect', 'available-from'),
    ),
    'closing a closed track begins a pause': Fault(
        '        if self.track_open:\n            # GRID_ACTIVE may',
        '        if True:\n            # GRID_ACTIVE may',
        ('effect', 'available-from'),
    ),
    'a race goes home from the grid with a kart that may be moving': Fault(
        'if each.may_be_moving or (each.doubt and not each.connected)',
        'if each.doubt and not each.connected',
        ('availability',),
    ),
    'a race goes home from the grid with a kart that has an unanswered stop': Fault(
        'if each.may_be_moving or (each.doubt and not each.connected)',
        'if (each.may_be_moving and each.hold is None) or (each.doubt and not each.connected)',
        ('availability',),
    ),
    'a race never goes home from the grid with a kart on it': Fault(
        'if each.may_be_moving or (each.doubt and not each.connected)',
        'if each.doubt',
        ('availability', 'stuck'),
    ),
    'the statement that the MSR was used ends without a record': Fault(
        "return self._no_record() if self.msr_used else ''",
        "return ''",
        ('availability',),
    ),
    'a race cannot go home without a record': Fault(
        "return self._no_record() if self.msr_used else ''",
        'return self._no_record()',
        ('availability',),
    ),
}
"""Each fault under what it would mean on the track."""


def search(rules: ModuleType) -> None:
    """Search all worlds."""
    for bound, world in WORLDS.values():
        oracle.Search(rules, **world).run(bound)


def search_nearest_first(rules: ModuleType, begin: str | None) -> None:
    """Search all worlds: first the one to begin with, then the nearest states of each."""
    if begin is not None:
        bound, world = WORLDS[begin]
        oracle.Search(rules, **world).run(bound)
    for bound in NEAREST:
        for _, world in WORLDS.values():
            oracle.Search(rules, **world).run(bound)
    search(rules)


def test_the_rules_without_a_fault_pass_the_same_search() -> None:
    # Otherwise a fault could be found for the way in which it is put in.
    search(module_with(race, 'class Race:\n', 'class Race:\n'))


@pytest.mark.parametrize('name', FAULTS)
def test_the_search_finds(name: str) -> None:
    fault = FAULTS[name]
    rules = module_with(race, fault.old, fault.new)
    with pytest.raises(oracle.RuleBrokenError) as caught:
        search_nearest_first(rules, FAR.get(name))
    assert caught.value.name in fault.breaks, caught.value


def test_every_fault_that_is_far_is_a_fault() -> None:
    assert FAR.keys() <= FAULTS.keys()


def test_the_documents_say_how_many_properties_and_faults_there_are() -> None:
    text = (Path(__file__).parents[3] / 'docs' / 'testing.md').read_text(encoding='utf-8')
    assert f'It holds {len(oracle.PROPERTIES)} properties' in text
    assert f'{len(FAULTS)} faults put into `race.py`' in text
