# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The roster lists the karts, which of them are in the first race, and the heats (§3.F, §4.A).

This module turns text into a ``Roster`` or one ``RosterError``, and does nothing else. An official
edits the file by hand minutes before a race, so the error lists every fault at once, with its line
and what to write instead. The parser reads the YAML as a tree of nodes with their lines, never as
objects, and refuses every feature of YAML that the roster does not need.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
import contextlib
import dataclasses
import datetime
import enum
import ipaddress
import pathlib
import re
from typing import TypeVar

from evgp_node.entry_list import as_roster
import yaml

MOST_ENTRIES = 200
"""Maximum number of karts. Race control is built for 20 and tested with 100."""

# This is enough for a roster of that many karts, with comments.
MAX_BYTES = 200_000
MAX_NUMBER = 9999
# Texts of these lengths, in characters, fit beside the buttons of a window.
MAX_TEAM_LENGTH = 64
MAX_HEAT_LENGTH = 32
MAX_TRANSPONDER_LENGTH = 32
MOST_LAPS = 999
# A file with more faults is not a roster.
MOST_FAULTS = 100

_FIELDS = ('number', 'team', 'address', 'in_race')

_OPTIONAL = ('inspected', 'transponders')

_OF_A_HEAT = ('format', 'laps', 'grid_from', 'auto_finish')

_INT = 'tag:yaml.org,2002:int'
_BOOL = 'tag:yaml.org,2002:bool'
_STR = 'tag:yaml.org,2002:str'

_Read = TypeVar('_Read')


class RosterError(ValueError):
    """
    The roster cannot be used. The text tells the official who wrote it what to mend.

    It has one line for each fault, in the order of the file. Each line names the file and, if
    possible, the line in it: `karts.yaml:7: kart 3: address 10.0.0.3 is already kart 1's (line 4);
    give every kart its own address`.

    :ivar as_roster: another program's list of karts as a roster with gaps; empty if the file is no
        such list.
    """

    as_roster = ''


@dataclasses.dataclass(frozen=True)
class RosterEntry:
    """
    One kart in the roster.

    :ivar number: number of the kart, from 1 to 9999.
    :ivar team: name of the team.
    :ivar address: IPv4 address of the kart.
    :ivar in_race: whether the kart is in the first race.
    :ivar inspected: date of the kart's inspection, YYYY-MM-DD; empty if there was none.
    :ivar transponders: the kart's own transponders.
    """

    number: int
    team: str
    address: str
    in_race: bool
    inspected: str = ''
    transponders: tuple[str, ...] = ()


class Format(enum.Enum):
    """The format of a race, which determines how karts are placed."""

    RACE = 'race'
    TIME_TRIAL = 'time_trial'
    PRACTICE = 'practice'


@dataclasses.dataclass(frozen=True)
class Heat:
    """
    A heat: a group of karts that race together.

    :ivar karts: numbers of the karts, in ascending order.
    :ivar laps: number of laps that each kart must drive; 0 if the roster does not set it.
    :ivar grid_from: heat or format whose results give the starting order; empty if none.
    :ivar auto_finish: whether the timekeeper sends FINISH for a kart that completes its last lap.
    """

    name: str
    karts: tuple[int, ...] = ()
    format: Format = Format.RACE  # noqa: A003 - the field's name
    laps: int = 0
    grid_from: str = ''
    auto_finish: bool = False


@dataclasses.dataclass(frozen=True)
class Roster:
    """
    The karts of the event and its heats, in the order of the file. There is at least one kart.

    Numbers, addresses, transponders and names of heats are unique. Every kart of a heat is in the
    roster, and a heat never takes its starting order from itself.
    """

    entries: tuple[RosterEntry, ...]
    heats: tuple[Heat, ...] = ()


def load_roster(path: pathlib.Path) -> Roster:
    """
    Return the roster in a YAML file, which is the list of karts that §3.F requires.

    :raises RosterError: if the file cannot be read or is not a roster.
    """
    try:
        if path.is_fifo():
            raise RosterError(f'{path}: is a pipe, not a file; name a readable file')
        with path.open('rb') as file:
            content = file.read(MAX_BYTES + 1)
    except OSError as error:
        reason = error.strerror or str(error)
        raise RosterError(f'{path}: cannot be read ({reason}); name a readable file') from error
    except ValueError as error:  # a path that no file can have, for example with a null byte
        reason = f'is not a file name ({error}); name a readable file'
        raise RosterError(f'{path!s}: {reason}') from error
    # Check this before decoding, which would fail if the text was cut within a character.
    if len(content) > MAX_BYTES:
        raise RosterError(
            f'{path}: is larger than {MAX_BYTES:,} bytes; give the file of the roster, '
            'which needs four short lines for each kart'
        )
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
    Return the roster in a YAML text.

    :param source: name of the file, for messages.
    :raises RosterError: if the text is not a roster. No other exception is raised.
    """
    return _Parser(source).parse(text)


class _FaultError(Exception):
    """A fault that ends the reading of a part, at a line or (line 0) of the whole file."""

    def __init__(self, line: int, reason: str) -> None:
        super().__init__(line, reason)
        self.line = line
        self.reason = reason


class _Parser:
    """A parser of one text, which collects all faults in order to report them together."""

    def __init__(self, source: str) -> None:
        self._source = source
        self._faults: list[_FaultError] = []
        self._lines_of_numbers: dict[int, int] = {}
        self._every_number_known = True

    def parse(self, text: str) -> Roster:
        foreign, missing = as_roster(text)
        if foreign:
            error = RosterError(
                f"{self._source}: is a list of another program, not a roster. 'make -s roster "
                f"ROSTER={self._source} > new.yaml' (rcs_roster check) converts it. Then fill in "
                f'each {missing}, and check it again'
            )
            error.as_roster = foreign
            raise error
        try:
            roster = self._read(text)
        except _FaultError as fault:
            self._faults.append(fault)
        if not self._faults:
            return roster
        self._faults.sort(key=lambda fault: fault.line)
        lines = [
            f'{self._source}{f":{fault.line}" if fault.line else ""}: {fault.reason}'
            for fault in self._faults[:MOST_FAULTS]
        ]
        if len(self._faults) > MOST_FAULTS:
            lines.append(f'{self._source}: {len(self._faults) - MOST_FAULTS} more faults')
        raise RosterError('\n'.join(lines))

    def _read(self, text: str) -> Roster:
        root = self._compose(text)
        if root is None:
            raise _FaultError(0, "is empty; list the karts under 'karts:'")
        fields = self._fields(root, ('karts',), 'the roster', optional=('heats',))
        entries: list[RosterEntry] = []
        karts = fields.get('karts')
        if karts is not None:
            if not isinstance(karts, yaml.SequenceNode):
                self._note(karts, "'karts' is not a list; begin each kart with '- number: ...'")
            elif not karts.value:
                self._note(karts, "'karts' is empty; list at least one kart")
            elif len(karts.value) > MOST_ENTRIES:
                raise _fault(
                    karts,
                    f'lists {len(karts.value)} karts; list {MOST_ENTRIES} at most, and keep the '
                    'others in a roster of their own',
                )
            else:
                entries = list(self._entries(karts.value))
        heats = fields.get('heats')
        return Roster(tuple(entries), tuple(self._heats(heats)) if heats is not None else ())

    def _compose(self, text: str) -> yaml.Node | None:
        """
        Return the tree of the text, in which each node occurs once, with YAML's own types.

        Anchors let YAML grow without bound, and tags can name any type. A roster needs neither, so
        they are refused before the tree is built.
        """
        depth = 0
        with contextlib.suppress(yaml.YAMLError, ValueError, OverflowError):  # reported below
            self._refuse_cuts(text)
        try:
            for event in yaml.parse(text, Loader=yaml.SafeLoader):
                if isinstance(event, yaml.NodeEvent) and event.anchor is not None:
                    raise _fault(event, 'anchors (&, *) are not used here; write it out')
                if getattr(event, 'tag', None) is not None:
                    raise _fault(event, 'tags (!) are not used here; leave it out')
                if isinstance(event, yaml.CollectionStartEvent):
                    depth += 1
                elif isinstance(event, yaml.CollectionEndEvent):
                    depth -= 1
                # Limit the depth, because composing recurses. A kart's fields are three levels
                # deep.
                if depth > 10:
                    raise _fault(event, "is nested too deeply; list the karts under 'karts:'")
            return yaml.compose(text, Loader=yaml.SafeLoader)
        except yaml.MarkedYAMLError as error:
            raise _broken(text, error) from error
        except yaml.reader.ReaderError as error:  # a character that YAML forbids
            line = text.count('\n', 0, error.position) + 1
            reason = f'the character #x{error.character:04x} is not allowed'
            raise _not_yaml(line, reason) from error
        except (ValueError, OverflowError) as error:
            # PyYAML raises these for a number in an escape or a directive that is out of range.
            raise _not_yaml(0, error) from error

    def _refuse_cuts(self, text: str) -> None:
        """Report each comment after a name or in a list, because it may cut part of that off."""
        inside = 0
        for token in yaml.scan(text, Loader=yaml.SafeLoader):
            inside += isinstance(token, (yaml.FlowSequenceStartToken, yaml.FlowMappingStartToken))
            inside -= isinstance(token, (yaml.FlowSequenceEndToken, yaml.FlowMappingEndToken))
            if inside > 10:
                return  # nested too deeply, which is reported next
            name = isinstance(token, yaml.ScalarToken) and token.plain and _is_text(token.value)
            end = token.end_mark
            if (inside or name) and _COMMENT.match(text, end.index):
                self._faults.append(_FaultError(end.line + 1, CUT))

    def _entries(self, nodes: list[yaml.Node]) -> Iterator[RosterEntry]:
        """Check each kart on its own and against the earlier ones and yield it."""
        lines_of_numbers = self._lines_of_numbers
        owners: dict[str, tuple[str, int]] = {}
        carriers: dict[str, tuple[str, int]] = {}
        for position, node in enumerate(nodes, start=1):
            known = self._number_in(node)
            kart = f'kart entry {position}' if known is None else f'kart {known}'
            fields = self._tried(self._fields, node, _FIELDS, kart, _OPTIONAL) or {}
            number = self._tried(self._whole, fields.get('number'), f'{kart}: number')
            if number is None:
                self._every_number_known = False
            else:
                if number in lines_of_numbers:
                    self._note(
                        fields['number'],
                        f'kart {number}: number {number} is already taken '
                        f'(line {lines_of_numbers[number]}); give every kart its own number',
                    )
                lines_of_numbers.setdefault(number, _line(fields['number']))
            team = self._tried(self._team, fields.get('team'), kart)
            address = self._tried(self._address, fields.get('address'), kart)
            if address is not None:
                self._own(owners, address, fields['address'], kart, 'address')
            in_race = self._tried(self._truth, fields.get('in_race'), f'{kart}: in_race')
            inspected = self._tried(self._inspected, fields.get('inspected'), kart)
            transponders = self._tried(
                self._transponders, fields.get('transponders'), kart, carriers
            )
            if not (number is None or team is None or address is None or in_race is None):
                yield RosterEntry(
                    number, team, address, in_race, inspected or '', transponders or ()
                )

    def _own(
        self,
        owners: dict[str, tuple[str, int]],
        name: str,
        node: yaml.Node,
        kart: str,
        what: str,
    ) -> None:
        """Record which kart has something unique, or report that another kart already has it."""
        if name in owners:
            owner, line = owners[name]
            whose = f"is already {owner}'s (line {line}); give every kart its own {what}"
            self._note(node, f'{kart}: {what} {name} {whose}')
        else:
            owners[name] = kart, _line(node)

    def _transponders(
        self, node: yaml.Node, kart: str, carriers: dict[str, tuple[str, int]]
    ) -> tuple[str, ...]:
        right = 'give a list, such as [4711, 4712], or leave it out'
        if not isinstance(node, yaml.SequenceNode) or not node.value:
            raise _fault(node, f'{kart}: transponders {_shown(node)} is not a list; {right}')
        for each in node.value:
            name = _name(each, MAX_TRANSPONDER_LENGTH)
            if not name:
                raise _fault(
                    each,
                    f'{kart}: transponder {_shown(each)} is not a name; give 1 to '
                    f'{MAX_TRANSPONDER_LENGTH} printable characters, as the device reports it',
                )
            self._own(carriers, name, each, kart, 'transponder')
        return tuple(_name(each, MAX_TRANSPONDER_LENGTH) for each in node.value)

    def _heats(self, node: yaml.Node) -> Iterator[Heat]:
        """Check each heat on its own and against the karts and yield it."""
        right = "write each as '  Heat 1: [1, 2, 3]'"
        if not isinstance(node, yaml.MappingNode):
            self._note(node, f"'heats' is not a list of names, each with its karts; {right}")
            return
        if not node.value:
            self._note(node, f"'heats' is empty; {right}, or leave 'heats:' out")
        lines: dict[str, int] = {}
        for key, value in node.value:
            name = self._tried(self._heat_name, key)
            if name is not None:
                alike = ' '.join(name.casefold().split())
                if alike in lines:
                    self._note(
                        key,
                        f'heat {name!r} is already there (line {lines[alike]}); '
                        'give every heat its own name; capitals and spaces make no difference',
                    )
                lines.setdefault(alike, _line(key))
            heat = f'heat {name!r}' if name is not None else 'this heat'
            fields = {'karts': value}
            if isinstance(value, yaml.MappingNode):
                fields = self._tried(self._fields, value, ('karts',), heat, _OF_A_HEAT) or {}
            format_ = self._tried(self._format, fields.get('format'), heat)
            laps = self._tried(self._whole, fields.get('laps'), f'{heat}: laps', MOST_LAPS)
            grid_from = self._tried(self._grid_from, fields.get('grid_from'), heat, node, name)
            auto = self._tried(self._truth, fields.get('auto_finish'), f'{heat}: auto_finish')
            karts = self._tried(self._heat_karts, fields.get('karts'), heat)
            if name is not None and karts:
                in_order = tuple(sorted(karts))
                format_ = format_ or Format.RACE
                yield Heat(name, in_order, format_, laps or 0, grid_from or '', auto or False)

    def _format(self, node: yaml.Node, heat: str) -> Format:
        try:
            return Format(node.value)
        except ValueError as error:
            known = ', '.join(each.value for each in Format)
            fault = f'{heat}: format {_shown(node)} is unknown; give one of {known}'
            raise _fault(node, fault) from error

    def _grid_from(
        self, node: yaml.Node, heat: str, heats: yaml.MappingNode, name: str | None
    ) -> str:
        source = node.value.strip() if isinstance(node, yaml.ScalarNode) else ''
        others = {key.value.strip() for key, _ in heats.value if isinstance(key, yaml.ScalarNode)}
        others -= {name}
        if source in others or source in [each.value for each in Format]:
            return str(source)
        raise _fault(
            node,
            f'{heat}: grid_from {_shown(node)} is not another heat; give the name of one, or of a '
            f'format ({", ".join(each.value for each in Format)}), or leave it out',
        )

    def _heat_name(self, node: yaml.Node) -> str:
        name = _name(node, MAX_HEAT_LENGTH)
        if name:
            return name
        raise _fault(
            node,
            f'heat {_shown(node)} has no name that can be displayed; '
            f'give it 1 to {MAX_HEAT_LENGTH} printable characters',
        )

    def _heat_karts(self, node: yaml.Node, heat: str) -> set[int]:
        karts: set[int] = set()
        if not isinstance(node, yaml.SequenceNode):
            raise _fault(
                node, f'{heat} is not a list of karts; give their numbers, such as [1, 2, 3]'
            )
        if not node.value:
            self._note(node, f'{heat} is empty; give the numbers of its karts, or leave it out')
        for each in node.value:
            number = self._tried(self._whole, each, f'{heat}: number')
            if number is None:
                continue
            if number in karts:
                self._note(each, f'{heat} has kart {number} already; give it once')
            elif self._every_number_known and number not in self._lines_of_numbers:
                self._note(
                    each,
                    f"{heat}: the roster has no kart {number}; give a number from 'karts:'",
                )
            karts.add(number)
        return karts

    def _fields(
        self,
        node: yaml.Node,
        names: tuple[str, ...],
        what: str,
        optional: tuple[str, ...] = (),
    ) -> dict[str, yaml.Node]:
        """Return a mapping's fields, and report any that are unknown, duplicate or missing."""
        if not isinstance(node, yaml.MappingNode):
            raise _fault(node, f'{what} has no fields; give it {_quoted(names)}')
        fields: dict[str, yaml.Node] = {}
        lines: dict[str, int] = {}
        for key, value in node.value:
            name = key.value if isinstance(key, yaml.ScalarNode) else None
            if name not in (*names, *optional):
                shown = 'that is not one word' if name is None else repr(name)
                self._note(
                    key,
                    f'{what} has the unknown field {shown}; it has {_quoted((*names, *optional))}',
                )
                continue
            if name in fields:
                self._note(key, f"{what} has '{name}' already (line {lines[name]}); give it once")
                continue
            fields[name] = value
            lines[name] = _line(key)
        missing = [name for name in names if name not in fields]
        if missing:
            it = 'it' if len(missing) == 1 else 'them'
            self._note(node, f'{what} has no {_quoted(missing)}; add {it}')
        return fields

    def _number_in(self, node: yaml.Node) -> int | None:
        """Return a kart's number, for messages about its other fields; None if it is unknown."""
        for key, value in node.value if isinstance(node, yaml.MappingNode) else ():
            if isinstance(key, yaml.ScalarNode) and key.value == 'number':
                try:
                    return self._whole(value, '')
                except _FaultError:
                    return None
        return None

    def _whole(self, node: yaml.Node, what: str, most: int = MAX_NUMBER) -> int:
        # Accept only decimal numbers, because YAML would read 010 as eight and 1:30 as ninety.
        decimal = node.tag == _INT and re.fullmatch('[1-9][0-9]{0,3}', node.value)
        if decimal and int(node.value) <= most:
            return int(node.value)
        raise _fault(
            node,
            f'{what} {_shown(node)} is not valid; '
            f'give a whole number from 1 to {most}, without quotes',
        )

    def _team(self, node: yaml.Node, kart: str) -> str:
        team = _name(node, MAX_TEAM_LENGTH)
        if team and node.tag == _STR:
            return team
        raise _fault(
            node,
            f'{kart}: team {_shown(node)} is not a name; give 1 to {MAX_TEAM_LENGTH} printable '
            'characters, in quotes if they look like a number or a yes or no',
        )

    def _address(self, node: yaml.Node, kart: str) -> str:
        right = "give the kart's own IPv4 address, such as 10.0.0.101"
        try:
            address = ipaddress.IPv4Address(str(node.value))
        except ValueError as error:
            why = f' ({error})' if 'eading zero' in str(error) else ''
            raise _fault(
                node, f'{kart}: address {_shown(node)} is not an IPv4 address{why}; {right}'
            ) from error
        # No kart can connect from such an address.
        if address.packed[0] == 0 or address.is_multicast or address.is_reserved:
            kind = 'a multicast' if address.is_multicast else 'an unspecified or broadcast'
            raise _fault(
                node,
                f'{kart}: address {address} is {kind} address, which no kart can have; {right}',
            )
        return str(address)

    def _truth(self, node: yaml.Node, what: str) -> bool:
        if node.tag != _BOOL:
            raise _fault(
                node,
                f'{what} {_shown(node)} is neither true nor false; '
                'give one of the two, without quotes',
            )
        return str(node.value).lower() in ('true', 'yes', 'on')

    def _inspected(self, node: yaml.Node, kart: str) -> str:
        text = str(node.value)
        if isinstance(node, yaml.ScalarNode) and re.fullmatch('[0-9]{4}-[0-9]{2}-[0-9]{2}', text):
            try:
                return datetime.date.fromisoformat(text).isoformat()
            except ValueError:
                pass  # such as the 31st of February
        raise _fault(
            node,
            f'{kart}: inspected {_shown(node)} is not a date; give the day of the inspection as '
            'YEAR-MONTH-DAY, such as 2026-05-01, or leave it out',
        )

    def _tried(
        self, read: Callable[..., _Read], node: yaml.Node | None, *context: object
    ) -> _Read | None:
        """Return what a node contains, or report its fault; None after a fault or without node."""
        if node is None:
            return None
        try:
            return read(node, *context)
        except _FaultError as fault:
            self._faults.append(fault)
            return None

    def _note(self, where: yaml.Node, reason: str) -> None:
        self._faults.append(_fault(where, reason))


_COMMENT = re.compile('[ \t]+#')

CUT = (
    "' #' begins a comment and cuts off the rest; put the text into quotes, or the comment on a "
    'line of its own'
)


def _name(node: yaml.Node, most: int) -> str:
    """Return the name in a scalar; empty if it is not 1 to `most` printable characters."""
    name = str(node.value).strip() if isinstance(node, yaml.ScalarNode) else ''
    return name if name.isprintable() and len(name) <= most else ''


def _is_text(scalar: str) -> bool:
    """Return whether a scalar may be a name, as a number, address, date or truth value is not."""
    return not re.fullmatch(r'[-.:\d]+|true|false|yes|no|on|off', scalar, re.IGNORECASE)


def _fault(where: yaml.Node | yaml.Event, reason: str) -> _FaultError:
    return _FaultError(_line(where), reason)


def _not_yaml(line: int, reason: object) -> _FaultError:
    return _FaultError(line, f'is not YAML ({reason}); compare it with config/karts.yaml')


_FIELD = re.compile(r'(?P<indent> *(?:- +)?)(?P<name>[A-Za-z_]+):(?P<glued>[^\s]?)(?P<rest>.*)')
"""A line that begins with a field, with or without a space after the colon."""


def _broken(text: str, error: yaml.MarkedYAMLError) -> _FaultError:
    """Return the fault of a text that is not YAML, worded for its author."""
    mark = error.problem_mark or error.context_mark
    if mark is None:
        return _not_yaml(0, error.problem or error.context)
    lines = text.splitlines() or ['']
    # PyYAML reports a fault of the last line at the end of the text.
    at = min(mark.line, len(lines) - 1)
    shown = lines[at]
    if '\t' in shown[: len(shown) - len(shown.lstrip())] or (error.problem or '').startswith(
        "found character '\\t'"
    ):
        return _FaultError(at + 1, 'has a tab character; use spaces instead')
    # Without a space after the colon, YAML sees no field, and then the next line does not fit.
    for number in range(at, max(at - 2, -1), -1):
        field = _FIELD.match(lines[number])
        if (
            field
            and field['glued']
            and field['name'] in (*_FIELDS, *_OPTIONAL, *_OF_A_HEAT, 'karts', 'heats')
        ):
            right = f'{field["name"]}: {field["glued"]}{field["rest"]}'.rstrip()
            return _FaultError(number + 1, f'has no space after the colon; write {right[:60]!r}')
    field, before = _FIELD.match(shown), _FIELD.match(lines[at - 1]) if at else None
    second_colon = error.problem == 'mapping values are not allowed here'
    misfit = second_colon or (error.problem or '').startswith('expected <block end>')
    if misfit and field and '-' in field['indent']:
        return _FaultError(at + 1, "begin the '-' of every kart in the same column, with spaces")
    if misfit and field and before and len(field['indent']) != len(before['indent']):
        return _FaultError(
            at + 1,
            f'{field["name"]!r} does not begin below {before["name"]!r} of the previous line; '
            'begin all fields of a kart in the same column, with spaces',
        )
    if second_colon:
        return _FaultError(at + 1, 'has a second colon; put the text that has a colon in quotes')
    return _not_yaml(at + 1, error.problem or error.context)


def _line(where: yaml.Node | yaml.Event) -> int:
    """Return the number of the line, from 1, in which a node or event begins."""
    mark = where.start_mark
    assert mark is not None  # PyYAML's parser marks all nodes and events
    return mark.line + 1


def _shown(node: yaml.Node) -> str:
    """Return the content of a node for a message, in one short line."""
    if not isinstance(node, yaml.ScalarNode):
        return '(several values)' if node.value else '(nothing)'
    if node.value == '' and node.style is None:
        return '(nothing)'
    shown = repr(node.value) if node.style or not node.value.isprintable() else node.value
    return shown if len(shown) <= 40 else f'{shown[:37]}...'


def _quoted(names: Iterable[str]) -> str:
    return ', '.join(f"'{name}'" for name in names)
