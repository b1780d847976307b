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
Records between two marks, escaped, with a checksum and fields: what P3 and LapRF have in common.

A record is a mark, a header with length, checksum and type, fields (name, length, value), and a
mark. Numbers are little-endian. The checksum is that of the record before it is escaped, with
zeros in the place of the checksum. Inside, a mark or an escape is an escape and the byte, shifted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
import dataclasses

from evgp_timing.passings import Event, Refused

MAX_RECORD_BYTES = 1024
"""Maximum length of a record before it is escaped; those known have less than a hundred bytes."""


@dataclasses.dataclass(frozen=True)
class Record:
    """A whole record; of a field that is in it several times, the last value."""

    kind: int
    fields: dict[int, bytes]

    def number(self, name: int, size: int) -> int | None:
        """Return the number in a field of so many bytes; None: there is no such field."""
        value = self.fields.get(name, b'')
        return int.from_bytes(value, 'little') if len(value) == size else None


@dataclasses.dataclass(frozen=True)
class Framing:
    """
    How one protocol makes a record.

    :ivar head: what stands between the first mark and the type, with zeros for what is computed.
    :ivar length_at: index of the two bytes of the length, in the record before it is escaped.
    :ivar checksum_at: of the two bytes of the checksum.
    """

    begin: int
    end: int
    escape: int
    shift: int
    head: bytes
    length_at: int
    checksum_at: int
    checksum: Callable[[bytes], int]

    def encode(self, kind: int, fields: Iterable[tuple[int, bytes]]) -> bytes:
        """Return a record as it goes over the line."""
        body = b''.join(bytes((name, len(value))) + value for name, value in fields)
        record = bytearray((self.begin, *self.head, *kind.to_bytes(2, 'little'), *body, self.end))
        record[self.length_at : self.length_at + 2] = len(record).to_bytes(2, 'little')
        checksum = self.checksum(bytes(record)).to_bytes(2, 'little')
        record[self.checksum_at : self.checksum_at + 2] = checksum
        special = (self.begin, self.end, self.escape)
        inside = (
            (self.escape, byte + self.shift) if byte in special else (byte,)
            for byte in record[1:-1]
        )
        return bytes((self.begin, *(each for pair in inside for each in pair), self.end))

    def open(self, record: bytes) -> Record | Refused:
        """Return what is in a record that is not escaped any more, with its marks."""
        at, last = 1 + len(self.head) + 2, len(record) - 1
        if last < at:
            return Refused('a record is too short')
        checksum = slice(self.checksum_at, self.checksum_at + 2)
        blank = bytearray(record)
        blank[checksum] = b'\0\0'
        if self.checksum(bytes(blank)) != int.from_bytes(record[checksum], 'little'):
            return Refused('a checksum is wrong')
        fields: dict[int, bytes] = {}
        kind = int.from_bytes(record[at - 2 : at], 'little')
        while at < last:
            begin = at + 2
            end = begin + record[at + 1]
            if end > last:
                return Refused('a field is longer than its record')
            fields[record[at]] = record[begin:end]
            at = end
        return Record(kind, fields)


class RecordDecoder:
    """
    Finds records in a stream. Bytes outside a record are passed over.

    :param read: what a whole record says.
    """

    def __init__(self, framing: Framing, read: Callable[[Record], Event]) -> None:
        """Begin outside a record."""
        self._framing = framing
        self._read = read
        self._record = bytearray()
        self._escaped = False

    def feed(self, data: bytes) -> list[Event]:
        """Return what these bytes complete."""
        framing = self._framing
        found: list[Event] = []
        for byte in data:
            if byte == framing.begin:
                if self._record:
                    found.append(Refused('a record is cut short'))
                self._record = bytearray((byte,))
                self._escaped = False
            elif not self._record:
                continue
            elif byte == framing.end:
                opened = framing.open(bytes((*self._record, byte)))
                found.append(opened if isinstance(opened, Refused) else self._read(opened))
                self._record.clear()
            elif len(self._record) == MAX_RECORD_BYTES:
                found.append(Refused('a record is too long'))
                self._record.clear()
            elif byte == framing.escape and not self._escaped:
                self._escaped = True
            else:
                self._record.append((byte - framing.shift) % 256 if self._escaped else byte)
                self._escaped = False
        return found
