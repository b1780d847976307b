# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Bytes to passings: what was recorded of devices, any bytes, and bytes that were broken."""

from __future__ import annotations

import functools
import itertools

from evgp_node.results import Passing
from evgp_timing import laprf, p3
from evgp_timing.framing import Framing, MAX_RECORD_BYTES, Record
from evgp_timing.kinds import DECODERS
from evgp_timing.passings import Event, of_device, Refused, Unchecked
from hypothesis import given
from hypothesis import strategies as st
import pytest
from recorded_bytes import check_stream, encoded, P3_FIELD, p3_passing, RECORDED

every_kind = pytest.mark.parametrize('kind', DECODERS)
every_framing = pytest.mark.parametrize('framing', [p3.P3, laprf.LAPRF])

FIELDS = st.lists(
    st.tuples(st.integers(0, 255), st.binary(max_size=20)), unique_by=lambda field: field[0]
)


def cut(data: bytes, at: list[int]) -> list[bytes]:
    """Return a stream in pieces, cut at these places."""
    places = [0, *sorted(min(each, len(data)) for each in at), len(data)]
    return [data[a:b] for a, b in itertools.pairwise(places)]


@pytest.mark.parametrize(('kind', 'records'), [*RECORDED.items(), ('p3', P3_FIELD)])
def test_what_was_recorded_of_a_device_says_what_it_means(
    kind: str, records: list[tuple[bytes, Event]]
) -> None:
    for record, event in records:
        (found,) = DECODERS[kind]().feed(record)
        assert (type(found), found) == (type(event), event)


@pytest.mark.parametrize(
    ('label', 'transponder'),
    [(b'', '7'), (b'7', '7'), (b' AB 1\0\0', '7 AB 1'), (b'A\nB', '7'), (b'\xff', '7')],
)
def test_a_label_that_says_nothing_more_or_cannot_be_shown_is_left_out(
    label: bytes, transponder: str
) -> None:
    assert DECODERS['p3']().feed(p3_passing(1, 7, 1, label)) == [of_device(1, 1, transponder)]


def test_what_is_left_of_a_record_without_a_checksum_is_refused() -> None:
    (record,) = [each for each, event in P3_FIELD if isinstance(event, Unchecked)]
    for begin, end in itertools.combinations(range(1, len(record)), 2):
        found = DECODERS['p3']().feed(b'\x8e' + record[begin:end] + b'\x8f')
        assert (begin, end) == (1, len(record) - 1) or all(isinstance(e, Refused) for e in found)


def test_only_p3_may_lack_a_checksum() -> None:
    record, _ = RECORDED['laprf'][-1]
    assert laprf.LAPRF.unpack(record[1:3] + b'\0\0' + record[5:-1]) == Refused(
        'a checksum is wrong'
    )


@every_kind
@given(
    parts=st.lists(st.integers(0, 2) | st.binary(max_size=60), max_size=10),
    at=st.lists(st.integers(0, 500), max_size=8),
)
def test_garbage_between_records_loses_none_that_is_whole_however_a_stream_is_cut(
    kind: str, parts: list[int | bytes], at: list[int]
) -> None:
    records = RECORDED[kind]
    said = [
        (each, None) if isinstance(each, bytes) else records[each % len(records)] for each in parts
    ]
    data = b''.join(part for part, _ in said)
    check_stream(kind, data, cut(data, at))
    passings = [each for each in DECODERS[kind]().feed(data) if isinstance(each, Passing)]
    assert passings == [event for _, event in said if isinstance(event, Passing)]


@pytest.mark.parametrize('kind', ['p3', 'laprf'])
def test_a_record_with_a_changed_byte_is_no_passing(kind: str) -> None:
    record, _ = RECORDED[kind][-1]
    for place, byte in itertools.product(range(len(record)), range(256)):
        changed = bytearray(record)
        changed[place] = byte
        found = DECODERS[kind]().feed(bytes(changed))
        assert changed == record or all(isinstance(each, Refused) for each in found)


@every_framing
@given(kind=st.integers(0, 0xFFFF), fields=FIELDS)
def test_what_is_encoded_is_decoded(
    framing: Framing, kind: int, fields: list[tuple[int, bytes]]
) -> None:
    data = encoded(framing, kind, fields)
    assert data.count(framing.begin) == data.count(framing.end) == 1
    assert framing.unpack(data[1:-1]) == Record(kind, dict(fields))


@every_framing
def test_a_field_longer_than_its_record_is_refused(framing: Framing) -> None:
    whole = encoded(framing, 1, [(1, b'abc')])
    record = bytearray(whole)
    record[-5] = 200  # the length of the field
    at = slice(framing.length_at + 2, framing.length_at + 4)
    record[at] = b'\0\0'
    record[at] = framing.checksum(bytes(record)).to_bytes(2, 'little')
    assert isinstance(framing.unpack(whole[1:-1]), Record)
    assert isinstance(framing.unpack(bytes(record[1:-1])), Refused)


P3_PASSING = functools.partial(encoded, p3.P3, p3.P3.passing)
NO_PASSING = {
    'p3': [
        P3_PASSING([(p3.Field.NUMBER, bytes(4)), (p3.Field.TRANSPONDER, bytes(4))]),
        P3_PASSING([(p3.Field.NUMBER, bytes(9)), (p3.Field.TRANSPONDER, b''), (4, bytes(8))]),
        *(b'\x8e' + bytes(length) + b'\x8f' for length in (0, 3, MAX_RECORD_BYTES + 5)),
    ],
    'laprf': [
        encoded(laprf.LAPRF, laprf.LAPRF.passing, [(laprf.Field.SLOT, b'\1')]),
        *(b'\x5a' + bytes(length) + b'\x5b' for length in (0, 3, MAX_RECORD_BYTES + 5)),
    ],
    'ilap': [
        b'\x01' + line + b'\r\n'
        for line in (
            b'@\t20\t7\t4242424',
            b'@\t20\t7\t4242424\t123',
            b'@\t20\t7\tname\t123.456',
            b'@\t20\t7\t4242424\t-1.000',
            b'@\t20\t7\t4242424\tnan\t1\t1',
            b'@',
            b'@' * (MAX_RECORD_BYTES + 1),
        )
    ],
}
"""Records and lines without a number, time or transponder, or of a length that none has."""


@pytest.mark.parametrize(
    ('kind', 'sent'), [(kind, sent) for kind, each in NO_PASSING.items() for sent in each]
)
def test_what_is_no_passing_is_refused_once(kind: str, sent: bytes) -> None:
    (refused,) = DECODERS[kind]().feed(sent)
    assert isinstance(refused, Refused)


def test_a_line_that_is_cut_short_is_refused_and_the_next_is_read() -> None:
    record, event = RECORDED['ilap'][1]
    refused, passing = DECODERS['ilap']().feed(record[:-4] + record)
    assert isinstance(refused, Refused)
    assert passing == event
