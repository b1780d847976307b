# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The messages between the two processes of race control, as bytes."""

from __future__ import annotations

import io

from evgp_protocol.states import RaceState
from evgp_rcs.karts.channel import Alive, Listening, pack, Request, Unpacker
from evgp_rcs.rules.catalogue import CommandKind
from evgp_rcs.rules.race import Command
from hypothesis import given, strategies

commands = strategies.builds(
    Command,
    kind=strategies.sampled_from(CommandKind),
    kart=strategies.none() | strategies.integers(),
    statement=strategies.booleans(),
    karts=strategies.frozensets(strategies.integers()),
    hold=strategies.none() | strategies.sampled_from(RaceState),
    heat=strategies.text(),
    official=strategies.text(),
    age=strategies.floats(0.0, 86_400.0),
)
requests = strategies.builds(
    Request,
    number=strategies.integers(min_value=1),
    command=commands,
    came=strategies.floats(allow_nan=False),
)


@given(
    strategies.lists(requests | strategies.sampled_from([Alive(True), Listening(('', 7))])),
    strategies.integers(1, 100),
)
def test_what_is_packed_comes_out_however_it_is_cut(messages: list[object], size: int) -> None:
    data = b''.join(map(pack, messages))
    unpacker = Unpacker()
    stream = io.BytesIO(data)
    parts = iter(lambda: stream.read(size), b'')
    come = [message for part in parts for message in unpacker.feed(part)]
    assert come == messages
    assert list(map(type, come)) == list(map(type, messages))
