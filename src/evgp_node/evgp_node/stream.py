# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Streams of typed entries, of which race control and the timekeeper each write one.

A stream begins with `Began` and consists of blocks of entries. Each block contains the number of
entries before it, so that a reader notices and counts missing entries.

This module is pure.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
import json
from typing import Any, Generic, NamedTuple, TypeVar
import zlib

from evgp_node.encoding import DAMAGED, reader, written

_Entry = TypeVar('_Entry')


class DamagedError(ValueError):
    """An entry or a block is damaged. The text says how."""


class Began(NamedTuple):
    """
    The first entry of a stream, with its wall time (ns since the epoch).

    :param run: id of the run; in the timekeeper's book, of the machine's start.
    """

    run: str
    wall_ns: int


class Gap(NamedTuple):
    """
    A place where entries are missing, which is not in the stream itself but found by its reader.

    :param entries: number of missing entries; 0 if it is unknown.
    :param why: the reason, as a phrase.
    :param damaged: True if the entries exist but cannot be read, False if they do not exist.
    """

    entries: int
    why: str
    damaged: bool = False

    def __str__(self) -> str:
        many = {0: 'entries are', 1: '1 entry is'}.get(self.entries, f'{self.entries} entries are')
        return f'{many} missing: {self.why}'


class Block(NamedTuple):
    """A part of a stream: the number of entries before it, and its own entries, encoded."""

    entries: int
    data: bytes

    @property
    def length(self) -> int:
        return self.data.count(b'\n')

    def compressed(self) -> bytes:
        """Return the block in its compressed form, which reveals damage."""
        return zlib.compress(b'%d\n%s' % self)

    @staticmethod
    def of(data: bytes) -> Block:
        """
        Return the block from its compressed form.

        :raises DamagedError: if the block is damaged.
        """
        try:
            entries, _, lines = zlib.decompress(data).partition(b'\n')
            return Block(int(entries), lines)
        except (zlib.error, ValueError, TypeError) as error:
            raise DamagedError(f'it cannot be read: {error}') from error


def joined(blocks: Iterable[Block]) -> Iterator[Block]:
    """Join blocks between which no entries are missing and yield the results."""
    parts: list[Block] = []
    expected = 0
    for block in blocks:
        if parts and block.entries != expected:
            yield Block(parts[0].entries, b''.join(part.data for part in parts))
            parts = []
        parts.append(block)
        expected = block.entries + block.length
    if parts:
        yield Block(parts[0].entries, b''.join(part.data for part in parts))


class Stream(Generic[_Entry]):
    """
    The encoding of one kind of stream.

    :param kinds: types of the entries: named tuples, or dataclasses that can be iterated.
    :param check: raises ValueError for an invalid entry.
    """

    def __init__(
        self, kinds: Sequence[Any], check: Callable[[_Entry], None] = lambda entry: None
    ) -> None:
        self._readers = {kind.__name__: reader(kind) for kind in kinds}
        self._check = check

    def encode(self, entry: _Entry) -> bytes:
        """Return an entry as a line of JSON with the name of its type and its fields."""
        fields: Any = entry
        return f'{written([type(entry).__name__, *fields])}\n'.encode()

    def decode(self, data: bytes, only: tuple[type[Any], ...] = ()) -> Iterator[_Entry]:
        """
        Yield the entries in encoded data, in order.

        :param only: if not empty, yield only entries of these types.
        :raises DamagedError: when it reaches a damaged entry.
        """
        begins = tuple(f'["{kind.__name__}"'.encode() for kind in only) or b''
        for number, line in enumerate(data.splitlines(), 1):
            if not line.startswith(begins):
                continue
            try:
                name, *fields = json.loads(line)
                entry: _Entry = self._readers[name](fields)
                self._check(entry)
            except DAMAGED as error:
                raise DamagedError(f'entry {number} cannot be read: {error!r:.200}') from error
            yield entry

    def entries_of(
        self, blocks: Iterable[tuple[int, bytes]], only: tuple[type[Any], ...] = ()
    ) -> Iterator[_Entry | Gap]:
        """
        Yield the entries and gaps of a stream.

        :param blocks: each block with its number, in order and compressed.
        :param only: if not empty, yield only entries of these types.
        """
        expected, why = 0, ''  # why: what is damaged since the last readable entry
        for number, data in blocks:
            try:
                block = Block.of(data)
                entries = list(self.decode(block.data, only))
            except DamagedError as error:
                why = why or f'block {number} is damaged: {error}'
                continue
            if block.entries < expected:
                why = f'block {number} is not in its place'
                continue
            if why or block.entries > expected:
                lost = 'the disk did not store them, or someone removed them'
                yield Gap(block.entries - expected, why or lost, bool(why))
                why = ''
            yield from entries
            expected = block.entries + block.length
        if why:
            yield Gap(0, why, damaged=True)
