# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Streams of typed entries, as race control and the timekeeper each write one.

`Began` is the first entry of every stream: by its id, the streams of a run are joined. Entries are
written in blocks. A block says how many entries came before it, so that missing ones are noticed
and counted.

Pure.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
import json
from typing import Any, Generic, NamedTuple, TypeVar
import zlib

from evgp_node.encoding import DAMAGED, reader, written

_Entry = TypeVar('_Entry')

SCHEMA_VERSION = 10
"""The version of the files that have such streams, in their ``user_version``."""


BOOK = 'timing.sqlite3'
"""The name of the timekeeper's book, beside the record."""


class DamagedError(ValueError):
    """An entry or a block is damaged; the text says what is wrong."""


class Began(NamedTuple):
    """
    The first entry of a stream.

    :param run: the id of the run, drawn at random: by it, streams of several programs are joined.
    :param program: which program writes this stream.
    :param wall_ns: when it began, in ns since the epoch.
    """

    run: str
    program: str
    wall_ns: int


class Gap(NamedTuple):
    """
    Entries are missing here; no stream has this, but whoever reads one finds it.

    :param entries: how many; 0: nobody knows.
    :param why: a phrase.
    :param damaged: what is there cannot be read; otherwise it is not there.
    """

    entries: int
    why: str
    damaged: bool = False

    def __str__(self) -> str:
        """Return it as a clause."""
        many = {0: 'entries are', 1: '1 entry is'}.get(self.entries, f'{self.entries} entries are')
        return f'{many} missing: {self.why}'


class Block(NamedTuple):
    """
    A part of a stream.

    :param entries: how many entries came before it.
    :param data: those that it has, encoded.
    """

    entries: int
    data: bytes

    @property
    def length(self) -> int:
        """Return how many entries it has."""
        return self.data.count(b'\n')

    def compressed(self) -> bytes:
        """Return the block in few bytes, which show whether they were damaged."""
        return zlib.compress(b'%d\n%s' % self)

    @staticmethod
    def of(data: bytes) -> Block:
        """
        Return the block that was compressed.

        :raises DamagedError: if it is damaged.
        """
        try:
            entries, _, lines = zlib.decompress(data).partition(b'\n')
            return Block(int(entries), lines)
        except (zlib.error, ValueError, TypeError) as error:
            raise DamagedError(f'it cannot be read: {error}') from error


def joined(blocks: Iterable[Block]) -> Iterator[Block]:
    """Yield the same entries in few blocks: a new one only where some are missing."""
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
    How the entries of a kind of stream are written and read.

    :param kinds: the types of its entries: named tuples, or dataclasses that can be iterated.
    :param check: raises ValueError for an entry that no program writes.
    """

    def __init__(
        self, kinds: Sequence[Any], check: Callable[[_Entry], None] = lambda entry: None
    ) -> None:
        self._readers = {kind.__name__: reader(kind) for kind in kinds}
        self._check = check

    def encode(self, entry: _Entry) -> bytes:
        """Return an entry as a line: a list of the name of its type and its fields."""
        fields: Any = entry
        return f'{written([type(entry).__name__, *fields])}\n'.encode()

    def decode(self, data: bytes, only: tuple[type[Any], ...] = ()) -> Iterator[_Entry]:
        """
        Yield the entries that were encoded, in order.

        :param only: leave out all but those of these types, if there are any here.
        :raises DamagedError: where they are damaged.
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
        Yield the entries of a stream, and where some are missing.

        :param blocks: each block with its number, in order and compressed.
        :param only: leave out all but entries of these types, if there are any here.
        """
        expected = 0
        why, damaged = '', False
        for number, data in blocks:
            try:
                block = Block.of(data)
                entries = list(self.decode(block.data, only))
            except DamagedError as error:
                why, damaged = why or f'block {number} is damaged: {error}', True
                continue
            if block.entries < expected:
                why, damaged = f'block {number} is not in its place', True
                continue
            if why or block.entries > expected:
                lost = 'the disk took none, or they were removed'
                yield Gap(block.entries - expected, why or lost, damaged)
                why, damaged = '', False
            yield from entries
            expected = block.entries + block.length
        if why:
            yield Gap(0, why, damaged)
