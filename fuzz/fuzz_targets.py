# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The fuzz targets: one function each, which takes bytes and raises if a promise is broken.

This module does not depend on the fuzzer; the tests call the same functions with the corpus.
"""

from __future__ import annotations

from collections.abc import Callable
import ipaddress
import json
import pathlib
import random
import re
import tempfile
import zlib

from evgp_node import roster
from evgp_protocol import frames
from evgp_protocol.states import RaceState
from evgp_timing.kinds import DECODERS
from recorded_bytes import check_stream
import yaml

Event = frames.StateFrame | frames.MalformedFrame


def check_decoder(data: bytes) -> None:
    """
    Compare the decoder with the rules of docs/wire.md, however the stream is split.

    :raises AssertionError: if a promise of ``FrameDecoder`` is broken.
    """
    cut_at = random.Random(zlib.crc32(data))
    for ready in (False, True):
        expected, begun = by_bytes(data, ready)
        for pieces in (
            [data],
            [bytes([byte]) for byte in data],
            _cut(data, cut_at),
        ):
            decoder = frames.FrameDecoder(ready_is_grid_active=ready)
            events: list[Event] = []
            for piece in pieces:
                events += decoder.feed(piece)
                kept = [value for value in vars(decoder).values() if isinstance(value, bytes)]
                assert sum(map(len, kept)) < frames.MAX_FRAME_BYTES, kept
            found = [comparable(event) for event in events]
            assert found == expected, f'{found} is not {expected}'
            assert (decoder._frame != b'') == begun
            for state in RaceState:
                behind = decoder.feed(frames.encode(state))
                assert behind[-1:] == [frames.StateFrame(state)], (
                    f'{state} is lost behind {data!r}'
                )


def check_roster(data: bytes) -> None:
    """
    Load the bytes as a roster: the result must be a correct roster, or sentences that say why not.

    :raises AssertionError: if a promise of ``load_roster`` is broken; any other exception is a
        finding too.
    """
    try:
        loaded = _load(data)
    except roster.RosterError as error:
        # YAML ends a line at any of these; a fault may be reported after the last one.
        lines = len(re.split('\r\n|[\r\n\x85\u2028\u2029]', data.decode(errors='replace')))
        sentences = str(error).split('\n')
        assert len(sentences) <= roster.MOST_FAULTS + 1, f'too many to read: {len(sentences)}'
        for sentence in sentences:
            assert re.match(r'roster(:[1-9]\d*)?: ', sentence), sentence
            assert sentence.isprintable(), f'not one printable line: {sentence!r}'
            assert len(sentence) < 1000, f'too long to read: {sentence}'
            line = re.match(r'roster:(\d+):', sentence)
            assert line is None or int(line[1]) <= lines + 1, sentence
        return
    entries = loaded.entries
    assert entries, 'a roster without a kart'
    assert len({entry.number for entry in entries}) == len(entries), 'a number occurs twice'
    assert len({entry.address for entry in entries}) == len(entries), 'an address occurs twice'
    for entry in entries:
        assert type(entry.number) is int, entry
        assert 1 <= entry.number <= roster.MAX_NUMBER, entry
        assert 1 <= len(entry.team) <= roster.MAX_TEAM_LENGTH, entry
        assert entry.team.isprintable(), entry
        assert entry.team == entry.team.strip(), entry
        assert type(entry.in_race) is bool, entry
        address = ipaddress.IPv4Address(entry.address)
        assert str(address) == entry.address, entry
        assert not any((address.is_multicast, address.is_reserved, address.packed[0] == 0)), entry
    # Any other YAML reader must read the same in the file.
    for entry, plain in zip(entries, yaml.safe_load(data)['karts'], strict=True):
        assert plain['number'] == entry.number, entry
        assert plain['team'].strip() == entry.team, entry
        assert plain['address'] == entry.address, entry
        assert plain['in_race'] is entry.in_race, entry
    numbers = {entry.number for entry in entries}
    assert len({heat.name for heat in loaded.heats}) == len(loaded.heats), 'a heat occurs twice'
    for heat in loaded.heats:
        assert heat.karts, heat
        assert list(heat.karts) == sorted(set(heat.karts) & numbers), heat
        assert heat.name.isprintable(), heat
        assert 1 <= len(heat.name.strip()) == len(heat.name) <= roster.MAX_HEAT_LENGTH, heat
    again: dict[str, object] = {'karts': [_given(entry) for entry in entries]}
    if loaded.heats:
        again['heats'] = {
            heat.name: {**_given(heat), 'karts': heat.karts} for heat in loaded.heats
        }
    text = json.dumps(again, default=lambda each: each.value)  # YAML as well
    assert _load(text.encode()) == loaded, 'writing the roster and loading it again changes it'


def check_timing(data: bytes) -> None:
    """
    Feed the bytes to the decoder of every timing device, however the stream is split.

    :raises AssertionError: if a promise of `evgp_timing` is broken; so is any other exception.
    """
    pieces = _cut(data, random.Random(zlib.crc32(data)))
    for kind in DECODERS:
        check_stream(kind, data, pieces)


TARGETS: dict[str, Callable[[bytes], None]] = {
    'decoder': check_decoder,
    'roster': check_roster,
    'timing': check_timing,
}
"""Every target by its name, which is also the name of its corpus."""


def corpus(name: str) -> list[pathlib.Path]:
    """Return the committed inputs of a target."""
    return sorted((pathlib.Path(__file__).parent / 'corpus' / name).iterdir())


def by_bytes(data: bytes, ready: bool) -> tuple[list[object], bool]:
    """Return the events in a stream, byte by byte, and whether it ends inside a frame."""
    names = {state.value.encode(): state for state in RaceState}
    if ready:
        names[b'READY'] = RaceState.GRID_ACTIVE
    events: list[object] = []
    place, frame = 'between', b''
    for byte in data:
        if byte == ord('$'):
            if place == 'in':
                events.append(frame)
            place, frame = 'in', b'$'
        elif place == 'between':
            if byte not in b' \t\r\n\0':
                events.append(bytes([byte]))
                place = 'skipping'
        elif place == 'in':
            frame += bytes([byte])
            if byte == ord(';'):
                events.append(names.get(frame[1:-1], frame))
                place = 'between'
            elif byte > 127 or len(frame) == frames.MAX_FRAME_BYTES:
                events.append(frame)
                place = 'skipping'
    return events, place == 'in'


def comparable(event: Event) -> object:
    """Return what `by_bytes` says of an event: the state, or the bytes."""
    return event.state if isinstance(event, frames.StateFrame) else event.raw


def _cut(data: bytes, cut_at: random.Random) -> list[bytes]:
    pieces = []
    while data:
        length = cut_at.randint(1, 40)
        pieces.append(data[:length])
        data = data[length:]
    return pieces


def _load(data: bytes) -> roster.Roster:
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder, 'roster')
        path.write_bytes(data)
        try:
            return roster.load_roster(path)
        except roster.RosterError as error:
            raise roster.RosterError(str(error).replace(f'{folder}/', '')) from error


def _given(part: roster.RosterEntry | roster.Heat) -> dict[str, object]:
    """Return the fields of a part of a roster that do not have their default, but no name."""
    return {
        name: value
        for name, value in vars(part).items()
        if name != 'name' and value != getattr(type(part), name, None)
    }
