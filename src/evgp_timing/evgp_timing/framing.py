# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Finds data between two marks in a stream, and reads the record format that P3 and LapRF share.

A record consists of a mark, a header with length, checksum and type, some fields (name, length and
value), and another mark. Numbers are little-endian. The checksum covers the unescaped record, with
zeros in place of the checksum itself. Inside a record, the sender shifts each byte that equals a
mark or the escape byte, and puts an escape byte before it.
"""

from __future__ import annotations

from collections.abc import Callable
import dataclasses
import re

from evgp_timing.passings import Event, Refused, Sign

MAX_RECORD_BYTES = 1024
"""Maximum length between two marks, in bytes. Known records are shorter than 200 bytes."""


@dataclasses.dataclass(frozen=True)
class Record:
    """
    A complete record.

    :ivar fields: the value of each field. If a field occurs several times, the last one counts.
    :ivar checked: True if the checksum is correct, False if the record has no checksum.
    """

    kind: int
    fields: dict[int, bytes]
    checked: bool = True

    def number(self, name: int, size: int) -> int | None:
        """Return the number in a field of `size` bytes, or None without such a field."""
        value = self.fields.get(name, b'')
        return int.from_bytes(value, 'little') if len(value) == size else None


def _two(at: int) -> slice:
    return slice(at, at + 2)


@dataclasses.dataclass(frozen=True)
class Framing:
    """
    The record format of one protocol.

    :ivar begin: the mark at the beginning of a record.
    :ivar end: the mark at the end of a record.
    :ivar escape: the escape byte.
    :ivar shift: the number added to a byte that follows an escape byte.
    :ivar head: the bytes between the first mark and the type, with zeros for computed values.
    :ivar length_at: index of the two bytes of the length in the unescaped record, which the two
        bytes of the checksum follow.
    :ivar checksum: a function that computes the checksum of an unescaped record.
    :ivar passing: the type of a passing. All other records are signs of life.
    :ivar may_lack_checksum: whether a checksum of 0 means that the record has none and is valid.
    """

    begin: int
    end: int
    escape: int
    shift: int
    head: bytes
    length_at: int
    checksum: Callable[[bytes], int]
    passing: int
    may_lack_checksum: bool = False

    def unpack(self, inside: bytes) -> Record | Refused:
        """Return the record in the escaped bytes between two marks, or why they are refused."""
        plain = re.sub(
            re.escape(bytes((self.escape,))) + rb'(.)',
            lambda pair: bytes(((pair[1][0] - self.shift) % 256,)),
            inside,
            flags=re.DOTALL,
        )
        record = bytearray((self.begin, *plain, self.end))
        at, last = 1 + len(self.head) + 2, len(record) - 1
        if last < at:
            return Refused('a record is too short')
        place = _two(self.length_at + 2)
        checksum, record[place] = record[place], b'\0\0'
        checked = self.checksum(bytes(record)) == int.from_bytes(checksum, 'little')
        # The rest of a truncated record may also have zeros in that place.
        whole = int.from_bytes(record[_two(self.length_at)], 'little') == len(record)
        if not checked and (any(checksum) or not self.may_lack_checksum or not whole):
            return Refused('a checksum is wrong')
        fields: dict[int, bytes] = {}
        kind = int.from_bytes(record[_two(at - 2)], 'little')
        while at < last:
            begin, end = at + 2, at + 2 + record[at + 1]
            if end > last:
                return Refused('a field is longer than its record')
            fields[record[at]] = bytes(record[begin:end])
            at = end
        return Record(kind, fields, checked)

    def decoder(self, read: Callable[[Record], Event]) -> MarkedDecoder:
        """Return a decoder for one connection, in which `read` interprets each passing."""

        def read_inside(inside: bytes) -> Event:
            record = self.unpack(inside)
            if isinstance(record, Refused):
                return record
            return read(record) if record.kind == self.passing else Sign()

        return MarkedDecoder(self.begin, self.end, read_inside)


class MarkedDecoder:
    """
    A decoder that finds the data between two marks in a stream, and skips all other bytes.

    It decodes the bytes of one connection and never raises an exception.

    :param read: a function that interprets the bytes between the marks.
    """

    def __init__(self, begin: int, end: int, read: Callable[[bytes], Event]) -> None:
        self._begin, self._end = bytes((begin,)), bytes((end,))
        self._marks = re.compile(b'(?=[%b])' % re.escape(self._begin + self._end))
        self._read = read
        self._inside: bytes | None = None

    def feed(self, data: bytes) -> list[Event]:
        """Return the events that these bytes complete. The bytes may be split anywhere."""
        found: list[Event] = []
        for part in self._marks.split(data):
            if part.startswith(self._begin):
                if self._inside is not None:
                    found.append(Refused('a record is cut short'))
                self._inside, part = b'', part[1:]
            if self._inside is None:
                continue
            if part.startswith(self._end):
                found.append(self._read(self._inside))
                self._inside = None
                continue
            self._inside += part
            if len(self._inside) > MAX_RECORD_BYTES:
                found.append(Refused('a record is too long'))
                self._inside = None
        return found
