"""
Faults put into the rules of the race on purpose: the oracle's search must find every one.

This is the test of the oracle. A property that no fault can break proves nothing.
"""

from __future__ import annotations

import importlib
from pathlib import Path
import sys
from types import ModuleType
from typing import NamedTuple

from evgp_rcs import race
import pytest

sys.path.insert(0, str(Path(__file__).parent))
oracle = importlib.import_module('race_oracle')

# Of two karts, both in the race to begin with; every fault here is found well before.
BOUND = 3000


class Fault(NamedTuple):
    """A fault: what is put in place of what, and the properties one of which it must break."""

    old: str
    new: str
    breaks: tuple[str, ...]


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
        '        if kart.connected:\n            if state is GREEN_GREEN:\n',
        '        if True:\n            if state is GREEN_GREEN:\n',
        ('order-wrong',),
    ),
    'a stop is announced as allowed, and refused': Fault(
        '        refusal = refusal or rule.refusal(self, kart)\n',
        '        refusal = refusal or rule.refusal(self, kart)\n'
        '        if command.kind is CommandKind.ALL_KILL and self.state is IN_GARAGE:\n'
        "            refusal = 'nothing is under way'\n",
        ('stop-refused',),
    ),
    'an acknowledgement survives the connection': Fault(
        '        kart.connected = False\n        kart.acknowledged = False\n',
        '        kart.connected = False\n',
        ('ack-survives',),
    ),
    'a new connection goes on under the old serial': Fault(
        '        kart.serial += 1\n        kart.acknowledged = False\n',
        '        kart.serial += changed\n        kart.acknowledged = False\n',
        ('order-serial',),
    ),
    'a reconnection lets a hold be forgotten': Fault(
        '        kart.lost_since = None\n        kart.reported = None\n',
        '        kart.lost_since = None\n        kart.hold = None\n',
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
        ('drop-not-held',),
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
        'CommandKind.KART_RED_RED: Rule(Race._kart_red_red,',
        'CommandKind.KART_RED_RED: Rule(Race._kart_red_red, Race._no_release,',
        ('availability', 'stop-refused'),
    ),
    'a stop that is in force is sent anew and its acknowledgement falls': Fault(
        '        if not (changed or anew):\n',
        '        if not (changed or anew or state is RED_RED):\n',
        ('stop-idempotent',),
    ),
    'a kart is not told at once': Fault(
        '            kart.hold_reason = reason\n        self._redirect(kart, now)\n',
        '            kart.hold_reason = reason\n',
        ('stop-at-once', 'sent-wrong'),
    ),
    'ALL_KILL forgets the karts outside the race': Fault(
        '        for each in self.karts.values():\n'
        "            self._hold(each, RED_RED, 'ALL_KILL', now)\n",
        '        for each in self.racing():\n'
        "            self._hold(each, RED_RED, 'ALL_KILL', now)\n",
        ('stop-at-once',),
    ),
    'GREEN_GREEN after another command than GRID_ACTIVE': Fault(
        'return race.grid_was_last and not self.is_command',
        'return race.grid_was_last',
        ('availability', 'green-needs-grid'),
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
        'held = [each for each in racing if each.hold is not None]',
        'held = [each for each in racing if each.hold is RED_FLAG]',
        ('availability',),
    ),
    'GRID_ACTIVE without the statement that the track is clear': Fault(
        'Race._grid_active, Race._no_grid_active, Race._state_track_clear',
        'Race._grid_active, Race._no_grid_active',
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
        'if each.connected and not each.acknowledged\n        ]',
        'if each.connected and not each.acknowledged and each.hold is None\n        ]',
        ('availability',),
    ),
    'IN_GARAGE releases a kart that never acknowledged its red': Fault(
        'if each.stopped or each.hold is None:',
        'if True:',
        ('hold-forgotten', 'red-loosened'),
    ),
    'IN_GARAGE leaves the use of the MSR in force for the next race': Fault(
        '        self.over = False\n        self.msr_used = False\n',
        '        self.over = False\n',
        ('effect',),
    ),
    'a release without the statement that a silent kart was made safe': Fault(
        "return '' if kart.stopped else f'{kart} was made safe by hand'",
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
        "self._hold(kart, RED_FLAG, f'finished in place {kart.place}', now)",
        'pass',
        ('sent-wrong', 'effect'),
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
        '        self.track_open = False\n        self.msr_used = False\n        self._go(GRID',
        '        self.msr_used = False\n        self._go(GRID',
        ('track-open-in-motion', 'effect'),
    ),
    'a kart lost in motion lets humans on the track': Fault(
        '            elif kart.may_be_moving:\n                unsafe',
        '            elif False:\n                unsafe',
        ('track-access', 'availability'),
    ),
    'a kart that was told to go counts as standing': Fault(
        '                kart.may_be_moving = True\n',
        '                pass\n',
        ('effect',),
    ),
    'a refused command takes GREEN_GREEN away': Fault(
        "            answer = Answer(False, f'{command.kind.value} refused: {refusal}.')\n",
        "            answer = Answer(False, f'{command.kind.value} refused: {refusal}.')\n"
        '            self.grid_was_last = False\n',
        ('refused-changes',),
    ),
    'a refusal does not name the kart': Fault(
        "f'{each}: ' + ('no GRID_ACTIVE yet'",
        "'' + ('no GRID_ACTIVE yet'",
        ('refusal-silent',),
    ),
    'looking at alerts acts': Fault(
        '        alerts = []\n        for kind, kart, due in self._alert_conditions():\n',
        '        alerts = []\n        self.track_open = False\n'
        '        for kind, kart, due in self._alert_conditions():\n',
        ('alerts-act',),
    ),
    'a lost kart raises no alert': Fault(
        '        if under_way or kart.may_be_moving:\n',
        '        if under_way and kart.may_be_moving:\n',
        ('alerts',),
    ),
    'a silent kart in RED_FLAG raises no alert': Fault(
        'kart.sent_since + self.times.flag_alert',
        'kart.sent_since + self.times.ready_alert + 9.0',
        ('alerts',),
    ),
    'the deadline of a finish is not announced': Fault(
        'for kart in self.karts.values() if kart.finish_due is not None]',
        'for kart in self.karts.values() if kart.finish_due is None and False]',
        ('deadline',),
    ),
    'GREEN_GREEN is announced after another command': Fault(
        "obstacle = self._no_green_green(None) if self.state is GRID_ACTIVE else ''",
        "obstacle = ''",
        ('false-news',),
    ),
    'a kart connecting during a race is sent IN_GARAGE': Fault(
        '        state = self._commanded(kart)\n',
        '        state = IN_GARAGE if anew else self._commanded(kart)\n',
        ('sent-wrong', 'red-loosened', 'order-wrong'),
    ),
}
"""Each fault under what it would mean on the track."""


def rules_with(old: str, new: str) -> ModuleType:
    """Return the rules, a second time and with one fault."""
    path = Path(race.__file__)
    text = path.read_text(encoding='utf-8')
    assert text.count(old) == 1, f'{text.count(old)} times in the rules: {old}'
    module = ModuleType('faulty_race')
    # A dataclass looks its module up by name.
    sys.modules[module.__name__] = module
    try:
        exec(compile(text.replace(old, new), str(path), 'exec'), module.__dict__)  # noqa: S102
    finally:
        del sys.modules[module.__name__]
    return module


def search(rules: ModuleType) -> oracle.Report:
    return oracle.Search(rules, racing=2, outside=0).run(BOUND)


def test_the_rules_without_a_fault_pass_the_same_search() -> None:
    # Otherwise a fault could be found for the way in which it is put in.
    assert search(rules_with('class Race:\n', 'class Race:\n')).states == BOUND


@pytest.mark.parametrize('fault', FAULTS.values(), ids=FAULTS.keys())
def test_the_search_finds(fault: Fault) -> None:
    rules = rules_with(fault.old, fault.new)
    with pytest.raises(oracle.RuleBrokenError) as caught:
        search(rules)
    assert caught.value.name in fault.breaks, caught.value
