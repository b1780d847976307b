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

"""What goes into the rules, as bytes and back, and that nothing goes in by another way."""

from __future__ import annotations

import ast
import dataclasses
import inspect
import json
import pathlib
from typing import Any, get_args, get_type_hints

from evgp_protocol.states import RaceState
from evgp_rcs import inputs, kart_process, kart_server
from evgp_rcs.catalogue import CommandKind
from evgp_rcs.inputs import Block, decode, encode, Entrant, InputsError, joined, Log, Setup
from evgp_rcs.race import (
    Command,
    Heat,
    KartMemory,
    Order,
    Outcome,
    Race,
    RaceMemory,
    RaceTimes,
    StartPhase,
)
from hypothesis import given
from hypothesis import strategies as st
import pytest

# Whatever a message can hold: also a lone surrogate, a NUL, 10 kB.
TEXTS = st.text(st.characters(), max_size=50)
TIMES = st.floats(allow_nan=False)
# A setup has a roster and parameters, which are read before: no numbers or texts but sound ones.
SETUP_TIMES = st.floats(-9e9, 9e9)
SETUP_KARTS = st.integers(1, 2**32 - 1)
SETUP_TEXTS = st.text(max_size=50)
KARTS = st.integers(0, 2**32 - 1)
STATES = st.sampled_from(RaceState)
FLAGS = st.booleans()
COMMANDS = st.builds(
    Command,
    kind=st.sampled_from(CommandKind),
    kart=st.integers(),
    statement=FLAGS,
    karts=st.frozensets(KARTS),
    hold=st.none() | STATES,
    heat=TEXTS,
    official=TEXTS,
)
MEMORIES = st.builds(
    RaceMemory,
    state=STATES,
    karts=st.dictionaries(KARTS, st.builds(KartMemory)),
    track_open=FLAGS,
    msr_used=FLAGS,
    final=FLAGS,
)
ORDERS = st.builds(Order, kart=KARTS, state=STATES, serial=KARTS)
NUMBERS = st.integers(0, 2**64 - 1)
ENTRIES = st.one_of(
    st.builds(inputs.Commanded, TIMES, COMMANDS, TIMES),
    st.builds(inputs.Connected, TIMES, KARTS),
    st.builds(inputs.Disconnected, TIMES, KARTS, TEXTS),
    st.builds(inputs.Heard, TIMES, KARTS, KARTS, STATES),
    st.builds(inputs.Tick, TIMES),
    st.builds(inputs.HeldUp, TIMES, TIMES),
    st.builds(inputs.Rival, TIMES, FLAGS),
    st.builds(inputs.RecordTrouble, TIMES, TEXTS),
    st.builds(inputs.StartBecame, TIMES, st.sampled_from(StartPhase), NUMBERS),
    st.builds(inputs.Recovered, TIMES, st.none() | MEMORIES),
    st.builds(inputs.Ordered, st.lists(ORDERS).map(tuple)),
    st.builds(inputs.Told, NUMBERS, NUMBERS),
    st.builds(inputs.Shown, TIMES, NUMBERS),
    st.builds(inputs.Published, NUMBERS, KARTS),
)

INPUTS: tuple[type[Any], ...] = get_args(inputs.Input)


def typed(entries: list[Any]) -> list[tuple[type[Any], Any]]:
    """Return entries such that two of different kinds are never equal."""
    return [(type(each), each) for each in entries]


@given(st.lists(ENTRIES))
def test_what_was_encoded_comes_back_to_the_last_bit(entries: list[Any]) -> None:
    data = b''.join(map(encode, entries))
    assert typed(list(decode(data))) == typed(entries)


@given(st.lists(ENTRIES, min_size=1), st.data())
def test_a_log_that_was_cut_into_blocks_comes_back_and_a_missing_block_is_noticed(
    entries: list[Any], data: st.DataObject
) -> None:
    log = Log(0.0)
    blocks = []
    for entry in entries:
        if isinstance(entry, INPUTS):
            log.add(entry)
        else:
            log.mark(entry)
        if data.draw(FLAGS):
            blocks.append(log.take())
    blocks.append(log.take())
    (whole,) = joined(blocks)
    assert Block.of(whole.compressed()) == whole
    assert typed(list(decode(whole.data))) == typed(entries)
    assert whole.length == len(entries)

    lost = data.draw(st.integers(0, len(blocks) - 1))
    rest = list(joined(each for n, each in enumerate(blocks) if n != lost))
    read = 0
    for block in rest:
        if block.entries != read:
            assert block.entries == read + blocks[lost].length
        read = block.entries + block.length
    assert len(rest) <= 1 + bool(blocks[lost].length)


@given(st.lists(ENTRIES, min_size=1, max_size=3), st.data())
def test_damaged_bytes_are_named_or_mean_something_else_and_raise_nothing_else(
    entries: list[Any], data: st.DataObject
) -> None:
    whole = bytearray(b''.join(map(encode, entries)))
    whole[data.draw(st.integers(0, len(whole) - 1))] ^= data.draw(st.integers(1, 255))
    cut = data.draw(st.integers(0, len(whole)))
    del whole[cut:]
    try:
        list(decode(bytes(whole)))
    except InputsError:
        pass


def test_a_block_of_which_one_byte_was_changed_is_refused() -> None:
    log = Log(0.0)
    log.add(inputs.Connected(1.0, 7))
    data = bytearray(log.take().compressed())
    data[len(data) // 2] ^= 1
    with pytest.raises(InputsError):
        Block.of(bytes(data))


@given(
    st.builds(
        Setup,
        karts=st.lists(
            st.builds(inputs.Entrant, SETUP_KARTS, SETUP_TEXTS, FLAGS, SETUP_TEXTS)
        ).map(tuple),
        times=st.builds(
            RaceTimes,
            finish_delays=st.lists(SETUP_TIMES).map(tuple),
            **{
                field.name: SETUP_TIMES
                for field in dataclasses.fields(RaceTimes)
                if field.type == 'float'
            },
        ),
        heats=st.lists(st.builds(Heat, SETUP_TEXTS, st.lists(SETUP_KARTS).map(tuple))).map(tuple),
        now=SETUP_TIMES,
    )
)
def test_a_setup_comes_back_from_json_to_the_last_bit(setup: Setup) -> None:
    assert Setup.from_json(setup.to_json()) == setup


@pytest.mark.parametrize('text', ['', '{}', '[]', '{"format": 2}', '{"format": 1}', '1'])
def test_a_setup_that_is_damaged_or_of_another_version_is_refused(text: str) -> None:
    with pytest.raises(InputsError):
        Setup.from_json(text)


# ----- that nothing goes into the rules by another way -------------------------------------


def ways_into_the_rules() -> set[str]:
    """Return the methods of a race that take an input."""
    return {
        name
        for name, method in inspect.getmembers(Race, inspect.isfunction)
        if not name.startswith('_') and get_type_hints(method).get('return') is Outcome
    }


def test_every_input_of_the_rules_can_be_logged() -> None:
    class Noting:
        state = RaceState.IN_GARAGE
        start = None

        def __getattr__(self, name: str) -> Any:
            return lambda *given: name

    fields = {'command': Command(CommandKind.ALL_KILL), 'memory': RaceMemory(STATES, {})}
    fed = [kind(*(fields.get(name, 0) for name in kind._fields)).feed(Noting()) for kind in INPUTS]
    assert sorted(fed) == sorted(ways_into_the_rules())


def test_the_kart_server_hands_nothing_to_the_rules_but_what_it_logs() -> None:
    ways = ways_into_the_rules()
    for module in (kart_server, kart_process):
        tree = ast.parse(pathlib.Path(str(module.__file__)).read_text(encoding='utf-8'))
        for node in ast.walk(tree):
            if isinstance(node, ast.Attribute) and ast.unparse(node.value).endswith('race'):
                assert node.attr not in ways, f'{module.__name__}: {ast.unparse(node)}'
    source = inspect.getsource(kart_server)
    assert source.count('.feed(') == 1


def test_a_setup_of_before_inspections_is_read() -> None:
    old = Setup((Entrant(1, 'Purdue', True),), RaceTimes(), (), 0.0)
    given = json.loads(old.to_json())
    given['karts'] = [kart[:3] for kart in given['karts']]
    del given['times']['require_inspection']
    assert Setup.from_json(json.dumps(given)) == old
