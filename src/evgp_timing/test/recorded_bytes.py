# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""What devices say, by public captures and descriptions, and what it means; for tests."""

from __future__ import annotations

from collections.abc import Iterable
import struct

from evgp_timing import p3
from evgp_timing.framing import Framing, MarkedDecoder
from evgp_timing.kinds import DECODERS
from evgp_timing.passings import Event, of_device, Sign, Unchecked

RECORDED: dict[str, list[tuple[bytes, Event]]] = {
    # A capture of a MYLAPS decoder that github.com/vmindru/ambp3client has for its tests.
    'p3': [
        (bytes.fromhex(record), event)
        for record, event in (
            ('8e021f00f3890000020001022800070216000c01760601008104131804008f', Sign()),
            (
                '8e02330053c800000100010451680200030473d75600040888f2fab51e83050005'
                '02b20006023400080200008104131804008f',
                of_device(1551542808933000, 157777, '5691251'),
            ),
            (
                # Its checksum has a byte that is escaped.
                '8e0233008dae400000010001047c680200030473d756000408882878f31e83050005'
                '02b20006021f00080200008104131804008f',
                of_device(1551543840549000, 157820, '5691251'),
            ),
        )
    ],
    # What github.com/fpvcult/laprf has for its tests.
    'laprf': [
        (bytes.fromhex(record), event)
        for record, event in (
            ('5a1c00d52b0cda02086051fcaf01000000200800000000000000005b', Sign()),
            (
                '5a2900735f09da200444003c000101022104010000000208e8bdc30400000000'
                '2202fa08230200005b',
                of_device(79937000, 1, '2'),
            ),
        )
    ],
    # By descriptions: the lines with a count and without one.
    'ilap': [
        (b'\x01#\t20\t5\t33\t0\txC249\r\n', Sign()),
        (
            b'\x01@\t20\t7\t4242424\t123.456\t38\t112\t2\tx1A2B\r\n',
            of_device(123456000, 0, '4242424'),
        ),
        (b'\x01@\t204\t3000999\t98.07\r\n', of_device(98070000, 0, '3000999')),
    ],
    # Ours: a transponder, nobody known, a sign of life.
    'lines': [
        (b'$kart-7,12.345\r\n', of_device(12345000, transponder='kart-7')),
        (b'$,4294967\n', of_device(4294967000000)),
        (b'$\n', Sign()),
    ],
}
"""Whole records of each kind with what each says, one after the other as a device sends them."""


P3_LIVE: list[tuple[bytes, Event]] = [
    (bytes.fromhex(record), event)
    for record, event in (
        (
            '8e021f006cb10000020001023500070210000601010a01008104d0000c008f',
            Sign(),
        ),
        (
            '8e023d0070040000010001048922000003042af71f060a08464c2d393438393005027f000602'
            '21000408350630ec65420600080200008104d0000c008f',
            of_device(1761855381964341, 8841, '102758186 FL-94890'),
        ),
        (
            '8e022b0030f3000001000104972200000304082700000408541f710666420600080200008104'
            'd0000c008f',
            of_device(1761855822438228, 8855, '9992'),
        ),
        (
            '8e023d0012850000010001049922000003042af71f060a08464c2d3934383930050285000602'
            '1d0004088501ca0866420600080200008104d0000c008f',
            of_device(1761855861817733, 8857, '102758186 FL-94890'),
        ),
        (
            '8e022b0022910000010001049b22000003040b2700000408e834cf0a66420600080200008104'
            'd0000c008f',
            of_device(1761855895713000, 8859, '9995'),
        ),
        (
            '8e023d0079e10000010001049d22000003042af71f060a08464c2d393438393005024c000602'
            '020004082996f60a66420600080200008104d0000c008f',
            of_device(1761855898293801, 8861, '102758186 FL-94890'),
        ),
        (
            '8e021f00bcd00000020001023e0007020f000601010a01008104d0000c008f',
            Sign(),
        ),
    )
]
"""What a decoder sent in 2025. Its transponders have labels, two are gates, and the capture kept a
selection: each count is odd."""

P3_FIELD: list[tuple[bytes, Event]] = [
    *P3_LIVE,
    (
        # Some decoders send no checksums.
        bytes.fromhex(
            '8e023300000000000100010448bc010003041d582c000408e805bfc4a41b050005026a000602'
            '3200080200008104930f02008f'
        ),
        Unchecked(*of_device(1437769372993000, 113736, '2906141')),
    ),
    # Every byte that is escaped.
    (
        bytes.fromhex('8e02250057e90000020001028daa0007028dab000c018dac06018dad81048dae0504008f'),
        Sign(),
    ),
]
"""What decoders in the field send."""


def encoded(framing: Framing, kind: int, fields: Iterable[tuple[int, bytes]]) -> bytes:
    """Return the bytes of a record with this type and these fields."""
    body = b''.join(bytes((name, len(value))) + value for name, value in fields)
    record = bytearray((framing.begin, *framing.head, *kind.to_bytes(2, 'little'), *body))
    record.append(framing.end)
    at = framing.length_at
    struct.pack_into('<H', record, at, len(record))
    struct.pack_into('<H', record, at + 2, framing.checksum(bytes(record)))
    sent = bytearray()
    for byte in record[1:-1]:
        special = byte in (framing.begin, framing.end, framing.escape)
        sent += bytes((framing.escape, byte + framing.shift)) if special else bytes((byte,))
    return bytes((framing.begin, *sent, framing.end))


def p3_passing(number: int, transponder: int, time_us: int, label: bytes = b'') -> bytes:
    """Return a passing as a P3 decoder sends it."""
    plain = (
        (p3.Field.NUMBER, number, 4),
        (p3.Field.TRANSPONDER, transponder, 4),
        (p3.Field.RTC_TIME, time_us, 8),
    )
    fields = [(name, value.to_bytes(size, 'little')) for name, value, size in plain]
    return encoded(p3.P3, p3.P3.passing, [*fields, (p3.Field.LABEL, label)])


def feed_all(decoder: MarkedDecoder, pieces: list[bytes]) -> list[Event]:
    """Return all that a decoder finds in these pieces."""
    return [event for piece in pieces for event in decoder.feed(piece)]


def check_stream(kind: str, data: bytes, pieces: list[bytes]) -> None:
    """
    Hold a decoder against what it promises for any bytes, cut into these pieces.

    :raises AssertionError: if how the stream is cut matters, or a record behind it is lost.
    """
    decoder = DECODERS[kind]()
    found = feed_all(decoder, pieces)
    for other in ([data], [bytes((byte,)) for byte in data]):
        assert feed_all(DECODERS[kind](), other) == found, kind
    for record, event in RECORDED[kind]:
        assert decoder.feed(record)[-1:] == [event], f'{event} is lost behind {data!r}'
