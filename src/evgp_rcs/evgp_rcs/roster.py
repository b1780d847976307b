"""
The roster: which karts there are, and who of them is in the first race (§3.F, §4.A).

Parsing only: text in, a ``Roster`` or one ``RosterError`` out. An official edits this file by
hand, minutes before a race, so that every fault is told with its line and with what would be
right. The YAML is read as a tree of nodes that know their lines, and never turned into objects:
whatever YAML could mean beyond the four fields is refused.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
import dataclasses
import ipaddress
import pathlib
import re

import yaml

# A roster of 1000 karts fits.
MAX_BYTES = 200_000
MAX_NUMBER = 9999
# What still fits beside the buttons of a GUI.
MAX_TEAM_LENGTH = 64

_FIELDS = ('number', 'team', 'address', 'in_race')

_INT = 'tag:yaml.org,2002:int'
_BOOL = 'tag:yaml.org,2002:bool'
_STR = 'tag:yaml.org,2002:str'


class RosterError(ValueError):
    """
    A roster that cannot be used; its text is one sentence for the official who wrote it.

    The sentence names the file and, where the fault stands in a line, the line: `karts.yaml:7:
    kart 3: address 10.0.0.3 is already kart 1's (line 4); give every kart its own address`.
    """


@dataclasses.dataclass(frozen=True)
class RosterEntry:
    """One kart: its number (1 to 9999), team, IPv4 address, and if it is in the first race."""

    number: int
    team: str
    address: str
    in_race: bool


@dataclasses.dataclass(frozen=True)
class Roster:
    """The karts of the event, at least one, in the order of the file; nothing is in it twice."""

    entries: tuple[RosterEntry, ...]


def load_roster(path: pathlib.Path) -> Roster:
    """
    Return the roster in a YAML file (§3.F: the list that race control is provided with).

    Raise RosterError where the file cannot be read or is not a roster.
    """
    try:
        if path.is_fifo():
            raise RosterError(f'{path}: is a pipe, and no file; name a readable file')
        with path.open('rb') as file:
            content = file.read(MAX_BYTES + 1)
    except OSError as error:
        reason = error.strerror or str(error)
        raise RosterError(f'{path}: cannot be read ({reason}); name a readable file') from error
    except ValueError as error:  # a path no file can have, such as one with a null byte
        raise RosterError(f'{path!s}: is no file name ({error}); name a readable file') from error
    # Judged before decoding, which a cut in the middle of a character would fail for.
    if len(content) > MAX_BYTES:
        raise _too_large(str(path))
    try:
        text = content.decode()
    except UnicodeDecodeError as error:
        line = content.count(b'\n', 0, error.start) + 1
        raise RosterError(
            f'{path}:{line}: is not UTF-8 text (byte 0x{content[error.start]:02x}); '
            'save the file as UTF-8'
        ) from error
    return parse_roster(text.removeprefix('\ufeff'), str(path))


def parse_roster(text: str, source: str) -> Roster:
    """
    Return the roster in a YAML text; source is what messages call the file.

    Raise RosterError, and nothing else, whatever the text is.
    """
    return _Parser(source).parse(text)


def _too_large(source: str) -> RosterError:
    return RosterError(
        f'{source}: is larger than {MAX_BYTES:,} bytes; give the file of the roster, '
        'which needs four short lines for each kart'
    )


class _Parser:
    """The parsing of one text; it only holds the name that messages begin with."""

    def __init__(self, source: str) -> None:
        self._source = source

    def parse(self, text: str) -> Roster:
        if len(text) > MAX_BYTES:
            raise _too_large(self._source)
        root = self._compose(text)
        if root is None:
            raise RosterError(f"{self._source}: is empty; list the karts under 'karts:'")
        fields = self._fields(root, ('karts',), 'the roster')
        karts = fields['karts']
        if not isinstance(karts, yaml.SequenceNode):
            raise self._error(karts, "'karts' is not a list; begin each kart with '- number: ...'")
        if not karts.value:
            raise self._error(karts, "'karts' is empty; list at least one kart")
        return Roster(tuple(self._entries(karts.value)))

    def _compose(self, text: str) -> yaml.Node | None:
        """
        Return the tree of the text, with no node in it twice and no type named by the file.

        Anchors and tags have no use in a roster, and are what makes YAML able to grow without
        bound and to mean more than it says. They are refused as events, before there is a tree.
        """
        depth = 0
        try:
            for event in yaml.parse(text, Loader=yaml.SafeLoader):
                if isinstance(event, yaml.NodeEvent) and event.anchor is not None:
                    raise self._error(event, 'anchors (&, *) are not used here; write it out')
                if getattr(event, 'tag', None) is not None:
                    raise self._error(event, 'tags (!) are not used here; leave it out')
                if isinstance(event, yaml.CollectionStartEvent):
                    depth += 1
                elif isinstance(event, yaml.CollectionEndEvent):
                    depth -= 1
                # A list of karts in a mapping is three deep; composing recurses.
                if depth > 10:
                    raise self._error(event, "is nested too deep; list the karts under 'karts:'")
            return yaml.compose(text, Loader=yaml.SafeLoader)
        except RosterError:
            raise
        except yaml.MarkedYAMLError as error:
            mark = error.problem_mark or error.context_mark
            at = '' if mark is None else f':{mark.line + 1}'
            raise self._not_yaml(at, error.problem or error.context) from error
        except yaml.reader.ReaderError as error:  # a character that YAML forbids
            at = f':{text.count(chr(10), 0, error.position) + 1}'
            reason = f'the character #x{error.character:04x} is not allowed'
            raise self._not_yaml(at, reason) from error
        except (ValueError, OverflowError) as error:
            # PyYAML lets these out where an escape or a directive has a number it cannot take.
            raise self._not_yaml('', error) from error

    def _not_yaml(self, at: str, reason: object) -> RosterError:
        return RosterError(
            f'{self._source}{at}: is not YAML ({reason}); '
            'compare it with the roster that is shipped'
        )

    def _entries(self, nodes: list[yaml.Node]) -> Iterator[RosterEntry]:
        """Yield the karts of the list, each checked by itself and against those before it."""
        lines_of_numbers: dict[int, int] = {}
        owners: dict[str, tuple[int, int]] = {}
        for position, node in enumerate(nodes, start=1):
            fields = self._fields(node, _FIELDS, f'kart entry {position}')
            number = self._number(fields['number'], f'kart entry {position}')
            if number in lines_of_numbers:
                raise self._error(
                    fields['number'],
                    f'kart {number}: number {number} is already taken '
                    f'(line {lines_of_numbers[number]}); give every kart its own number',
                )
            lines_of_numbers[number] = _line(fields['number'])

            kart = f'kart {number}'
            entry = RosterEntry(
                number,
                self._team(fields['team'], kart),
                self._address(fields['address'], kart),
                self._in_race(fields['in_race'], kart),
            )
            if entry.address in owners:
                owner, line = owners[entry.address]
                raise self._error(
                    fields['address'],
                    f"{kart}: address {entry.address} is already kart {owner}'s (line {line}); "
                    'give every kart its own address',
                )
            owners[entry.address] = number, _line(fields['address'])
            yield entry

    def _fields(self, node: yaml.Node, names: tuple[str, ...], what: str) -> dict[str, yaml.Node]:
        """Return the fields of a mapping, which must have each of the names once and no other."""
        wanted = _quoted(names)
        if not isinstance(node, yaml.MappingNode):
            raise self._error(node, f'{what} is not a mapping; give it {wanted}')
        fields: dict[str, yaml.Node] = {}
        lines: dict[str, int] = {}
        for key, value in node.value:
            name = key.value if isinstance(key, yaml.ScalarNode) else None
            if name not in names:
                shown = 'a list or mapping' if name is None else repr(name)
                raise self._error(key, f'{what} has the unknown field {shown}; it has {wanted}')
            if name in fields:
                raise self._error(
                    key, f"{what} has '{name}' already (line {lines[name]}); give it once"
                )
            fields[name] = value
            lines[name] = _line(key)
        missing = [name for name in names if name not in fields]
        if missing:
            raise self._error(node, f'{what} has no {_quoted(missing)}; give it {wanted}')
        return fields

    def _number(self, node: yaml.Node, what: str) -> int:
        # Decimal only: YAML would read 010 as eight and 1:30 as ninety.
        if node.tag == _INT and re.fullmatch('[1-9][0-9]{0,3}', node.value):
            return int(node.value)
        raise self._error(
            node,
            f'{what}: number {_shown(node)} is not one; '
            f'give a whole number from 1 to {MAX_NUMBER}, without quotes',
        )

    def _team(self, node: yaml.Node, kart: str) -> str:
        if node.tag == _STR:
            team = str(node.value).strip()
            if team and team.isprintable() and len(team) <= MAX_TEAM_LENGTH:
                return team
        raise self._error(
            node,
            f'{kart}: team {_shown(node)} is no name; give 1 to {MAX_TEAM_LENGTH} printable '
            'characters, in quotes if they look like a number or a yes or no',
        )

    def _address(self, node: yaml.Node, kart: str) -> str:
        right = "give the kart's own IPv4 address, such as 192.168.1.101"
        try:
            address = ipaddress.IPv4Address(str(node.value))
        except ValueError as error:
            raise self._error(
                node, f'{kart}: address {_shown(node)} is no IPv4 address; {right}'
            ) from error
        # Nothing connects from these, so that the kart would wait for ever.
        if address.packed[0] == 0 or address.is_multicast or address.is_reserved:
            kind = 'a multicast' if address.is_multicast else 'an unspecified or broadcast'
            raise self._error(
                node, f'{kart}: address {address} is {kind} address and no kart has it; {right}'
            )
        return str(address)

    def _in_race(self, node: yaml.Node, kart: str) -> bool:
        if node.tag != _BOOL:
            raise self._error(
                node,
                f'{kart}: in_race {_shown(node)} is neither true nor false; '
                'give one of the two, without quotes',
            )
        return str(node.value).lower() in ('true', 'yes', 'on')

    def _error(self, where: yaml.Node | yaml.Event, reason: str) -> RosterError:
        return RosterError(f'{self._source}:{_line(where)}: {reason}')


def _line(where: yaml.Node | yaml.Event) -> int:
    """Return the number of the line, from 1, that something begins in."""
    mark = where.start_mark
    assert mark is not None  # parsing marks all it makes; others may leave the mark out
    return mark.line + 1


def _shown(node: yaml.Node) -> str:
    """Return what stands in a node, as a message shows it: in one line and not too long."""
    if not isinstance(node, yaml.ScalarNode):
        return '(a list or mapping)'
    if node.value == '' and node.style is None:
        return '(nothing)'
    shown = repr(node.value) if node.style or not node.value.isprintable() else node.value
    return shown if len(shown) <= 40 else f'{shown[:37]}...'


def _quoted(names: Iterable[str]) -> str:
    """Return names as a list in a sentence."""
    return ', '.join(f"'{name}'" for name in names)
