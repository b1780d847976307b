# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""What goes into the rules, as bytes and back, and that nothing goes in by another way."""

from __future__ import annotations

import ast
from collections.abc import Iterator
import contextlib
import inspect
import json
import pathlib
from typing import Any, get_args, get_type_hints

from evgp_node.encoding import read, written
from evgp_node.stream import Block, DamagedError, Gap, joined
from evgp_protocol.states import RaceState
from evgp_rcs.karts import process as kart_process
from evgp_rcs.karts import server as kart_server
from evgp_rcs.rules import inputs
from evgp_rcs.rules.catalogue import CommandKind
from evgp_rcs.rules.inputs import Batch, decode, encode, entries_of, Log
from evgp_rcs.rules.race import (
    Command,
    Outcome,
    Race,
    RaceMemory,
    StampedEvent,
)
from hypothesis import given
from hypothesis import strategies as st
import pytest
from rig.values import any_of, ANYTHING, Simple

# An event is made by us; the names in a setup and an attendance are checked before.
SOUND: Simple = {**ANYTHING, str: st.text(max_size=50), int: st.integers(1, 2**32 - 2)}
FLAGS = st.booleans()

OF_OURS = (StampedEvent, inputs.Rules, inputs.Attended)
ENTRIES = st.one_of(
    [any_of(each, SOUND if each in OF_OURS else ANYTHING) for each in get_args(inputs.Entry)]
)
INPUTS: tuple[type[Any], ...] = get_args(inputs.Input)


def typed(entries: list[Any]) -> list[tuple[type[Any], Any]]:
    """Return entries such that two of different kinds are never equal."""
    return [(type(each), each) for each in entries]


@given(st.lists(ENTRIES, min_size=1), st.data())
def test_a_log_cut_into_blocks_comes_back_to_the_last_bit_and_what_is_missing_is_counted(
    entries: list[Any], data: st.DataObject
) -> None:
    log = Log()
    batches = []
    for entry in entries:
        log.add(entry)
        if data.draw(FLAGS):
            batches.append(log.take())
    batches.append(log.take())
    blocks = [in_bytes(each) for each in batches if each.entries]
    (whole,) = joined(blocks)
    assert typed(list(entries_of([(1, whole.compressed())]))) == typed(entries)
    packed = [block.compressed() for block in blocks]
    assert typed(list(entries_of(enumerate(packed, 1)))) == typed(entries)

    lost = data.draw(st.integers(0, len(blocks) - 1))
    rest = joined(each for n, each in enumerate(blocks) if n != lost)
    found = list(entries_of((n, each.compressed()) for n, each in enumerate(rest, 1)))
    gaps = [each.entries for each in found if isinstance(each, Gap)]
    assert gaps == [blocks[lost].length] * (lost + 1 < len(blocks))  # the end nobody misses
    swapped = [*packed[1:], packed[0]]
    for harmed in (swapped, [*packed, packed[0]], [packed[0][:-1], *packed[1:]]):
        if harmed != packed:
            assert any(isinstance(each, Gap) for each in entries_of(enumerate(harmed, 1)))


def in_bytes(batch: Batch) -> Block:
    return Block(batch.first - 1, b''.join(map(encode, batch.entries)))


HOSTILE_JSON = (
    *('[' * 100_000, '1' + '0' * 4000, '1' + '0' * 5000, '-1', '4294967296', '1e999', 'NaN'),
    *('"x"', '"\\ud800"', 'null', '[]', '{}', 'true', '{', '\xff'),
)


def places_in(value: object, before: tuple[int, ...] = ()) -> Iterator[tuple[int, ...]]:
    """Yield the way to each value in a value of JSON; of a list of lists, to its first."""
    yield before
    if isinstance(value, list):
        alike = all(isinstance(each, list) for each in value[:2])
        for place, each in enumerate(value[:1] if alike else value):
            yield from places_in(each, (*before, place))


def with_hostile(text: str, where: tuple[int, ...], hostile: str) -> str:
    """Return JSON in which something else stands in one place."""
    inner = whole = [json.loads(text)]
    for step in (0, *where[:-1]):
        inner = inner[step]
    inner[(0, *where)[-1]] = 'here'
    return json.dumps(whole[0]).replace('"here"', hostile)


@given(ENTRIES, st.sampled_from(HOSTILE_JSON), st.data())
def test_whatever_stands_in_an_input_it_is_read_or_refused(
    entry: Any, hostile: str, data: st.DataObject
) -> None:
    text = encode(entry).decode()
    where = data.draw(st.sampled_from([*places_in(json.loads(text))]))
    with contextlib.suppress(DamagedError):
        list(decode(with_hostile(text, where, hostile).encode('latin-1')))


def test_a_block_of_which_one_byte_was_changed_is_refused() -> None:
    data = bytearray(Block(0, encode(inputs.Connected(1.0, 7))).compressed())
    data[len(data) // 2] ^= 1
    with pytest.raises(DamagedError):
        Block.of(bytes(data))


@given(any_of(RaceMemory))
def test_a_memory_comes_back(memory: RaceMemory) -> None:
    assert read(RaceMemory, written(memory)) == memory


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
        """A race that answers every input with the name of its method."""

        def __getattr__(self, name: str) -> Any:
            return lambda *given: name

    fields = {
        'command': Command(CommandKind.ALL_KILL),
        'memory': RaceMemory(RaceState.IN_GARAGE, {}),
    }
    given = [kind(*(fields.get(name, 0) for name in kind._fields)) for kind in INPUTS]
    fed = [inputs.feed(each, Noting()) for each in given]
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
