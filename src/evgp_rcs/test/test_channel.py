# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The messages between the two processes of race control, as bytes."""

from __future__ import annotations

import io

from evgp_rcs.karts.channel import Alive, Listening, pack, Request, Unpacker
from evgp_rcs.rules.catalogue import CommandKind
from evgp_rcs.rules.race import Command
from hypothesis import given, strategies

REQUESTS = strategies.builds(
    lambda number, official: Request(
        number, Command(CommandKind.ALL_KILL, official=official), 7.0
    ),
    strategies.integers(),
    strategies.text(),
)


@given(
    strategies.lists(REQUESTS | strategies.sampled_from([Alive(True), Listening(('', 7))])),
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
