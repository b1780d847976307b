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

from collections.abc import Callable, Iterable, Mapping
import contextlib
import dataclasses
import datetime
import enum
import functools
import ipaddress
import pathlib
import re
from typing import Any, TypeVar

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

_INT = 'tag:yaml.org,2002:int'
_BOOL = 'tag:yaml.org,2002:bool'
_STR = 'tag:yaml.org,2002:str'

_Value = TypeVar('_Value')


class RosterError(ValueError):
    """
    The roster cannot be used. The text tells the official who wrote it what to mend.

    It has one line for each fault, in the order of the file. Each line names the file and, if
    possible, the line in it: `karts.yaml:7: kart 3: address 10.0.0.3 is already in line 4; give
    every kart its own address`.

    :ivar as_roster: another program's list of karts as a roster with gaps; empty if the file is no
        such list.
    """

    as_roster = ''


@dataclasses.dataclass(frozen=True)
class RosterEntry:
    """
    One kart in the roster.

    :ivar number: number of the kart, from 1 to 9999.
    :ivar in_race: whether the kart is in the first race.
    :ivar inspected: date of the kart's inspection, YYYY-MM-DD; empty if there was none.
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

    def __str__(self) -> str:
        return self.value.replace('_', ' ')


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
            raise OSError('it is a pipe')
        with path.open('rb') as file:
            content = file.read(MAX_BYTES + 1)
    except (OSError, ValueError) as error:  # ValueError: a path such as one with a null byte
        reason = getattr(error, 'strerror', None) or str(error)
        raise RosterError(f'{path}: cannot be read ({reason}); name a readable file') from error
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
    foreign, missing = as_roster(text)
    if foreign:
        error = RosterError(
            f"{source}: is a list of another program, not a roster. 'make -s roster "
            f"ROSTER={source} > new.yaml' (rcs_roster check) converts it. Then fill in "
            f'each {missing}, and check it again'
        )
        error.as_roster = foreign
        raise error
    reading = _Reading()
    try:
        karts, heats = reading.roster(text)
    except _FaultError as fault:
        reading.faults.append(fault)
    if not reading.faults:
        for each in heats:
            each['karts'] = tuple(sorted(each['karts']))
        return Roster(
            tuple(RosterEntry(**each) for each in karts), tuple(Heat(**each) for each in heats)
        )
    faults = sorted(reading.faults, key=lambda fault: fault.line)
    lines = [
        f'{source}{f":{fault.line}" if fault.line else ""}: {fault.reason}'
        for fault in faults[:MOST_FAULTS]
    ]
    if len(faults) > MOST_FAULTS:
        lines.append(f'{source}: {len(faults) - MOST_FAULTS} more faults')
    raise RosterError('\n'.join(lines))


class _FaultError(Exception):
    """A fault at a line, or (line 0) of the whole file. If raised, it ends the reading."""

    def __init__(self, line: int, reason: str) -> None:
        super().__init__(line, reason)
        self.line = line
        self.reason = reason


# ----- single values --------------------------------------------------------------------------

# Each of these functions returns the value of a node, or raises a ValueError. The error's text
# follows the name of the field and what the node contains.


def _whole(node: yaml.Node, most: int = MAX_NUMBER) -> int:
    # Accept only decimal numbers, because YAML would read 010 as eight and 1:30 as ninety.
    decimal = node.tag == _INT and re.fullmatch('[1-9][0-9]{0,3}', node.value)
    if decimal and int(node.value) <= most:
        return int(node.value)
    raise ValueError(f'is not valid; give a whole number from 1 to {most}, without quotes')


def _name(node: yaml.Node, most: int) -> str:
    name = str(node.value).strip() if isinstance(node, yaml.ScalarNode) else ''
    if not (name and name.isprintable() and len(name) <= most):
        raise ValueError(f'is not a name; give 1 to {most} printable characters')
    return name


def _team(node: yaml.Node) -> str:
    name = _name(node, MAX_TEAM_LENGTH)
    if node.tag != _STR:
        raise ValueError('is not text; put a name that looks like a number, yes or no in quotes')
    return name


def _address(node: yaml.Node) -> str:
    right = "give the kart's own IPv4 address, such as 10.0.0.101"
    try:
        address = ipaddress.IPv4Address(str(node.value))
    except ValueError as error:
        why = f' ({error})' if 'eading zero' in str(error) else ''
        raise ValueError(f'is not an IPv4 address{why}; {right}') from error
    # No kart can connect from such an address.
    if address.packed[0] == 0 or address.is_multicast or address.is_reserved:
        kind = 'a multicast' if address.is_multicast else 'an unspecified or broadcast'
        raise ValueError(f'is {kind} address, which no kart can have; {right}')
    return str(address)


def _truth(node: yaml.Node) -> bool:
    if node.tag != _BOOL:
        raise ValueError('is neither true nor false; give one of the two, without quotes')
    return str(node.value).lower() in ('true', 'yes', 'on')


def _date(node: yaml.Node) -> str:
    text = str(node.value)
    if isinstance(node, yaml.ScalarNode) and re.fullmatch('[0-9]{4}-[0-9]{2}-[0-9]{2}', text):
        with contextlib.suppress(ValueError):  # such as the 31st of February
            return datetime.date.fromisoformat(text).isoformat()
    raise ValueError(
        'is not a date; give the day of the inspection as YEAR-MONTH-DAY, such as 2026-05-01, or '
        'leave it out'
    )


def _format(node: yaml.Node) -> Format:
    try:
        return Format(node.value)
    except ValueError as error:
        raise ValueError(f'is unknown; give one of {_FORMATS}') from error


def _grid_from(node: yaml.Node, sources: set[str]) -> str:
    source = node.value.strip() if isinstance(node, yaml.ScalarNode) else ''
    if source not in sources:
        raise ValueError(
            f'is not another heat; give the name of one, or of a format ({_FORMATS}), or leave it '
            'out'
        )
    return str(source)


_FORMATS = ', '.join(each.value for each in Format)

_Read = Callable[[yaml.Node], Any]
_Readers = Mapping[str, _Read | list[_Read]]


# ----- the whole ------------------------------------------------------------------------------


class _Loader(yaml.SafeLoader):
    """
    A loader that refuses anchors and tags, which a roster does not need.

    Anchors let YAML grow without bound, and tags can name any type. Without them, each node occurs
    once in the tree.
    """

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        event = self.peek_event()  # type: ignore[no-untyped-call]
        if event.anchor is not None:
            raise _fault(event, 'anchors (&, *) are not used here; write it out')
        if getattr(event, 'tag', None) is not None:
            raise _fault(event, 'tags (!) are not used here; leave it out')
        return super().compose_node(parent, index)


class _Reading:
    """The reading of one text, which collects all faults to report them together."""

    def __init__(self) -> None:
        self.faults: list[_FaultError] = []
        self._first: dict[tuple[object, object], yaml.Node] = {}
        # None if a kart's number is unknown, so that a heat may name it.
        self._numbers: set[int | None] = {None}

    def roster(self, text: str) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
        """
        Return the fields of each kart and of each heat, which are right if there are no faults.

        :raises _FaultError: if the rest of the text cannot be read.
        """
        root = self._compose(text)
        if root is None:
            raise _FaultError(0, "is empty; list the karts under 'karts:'")
        parts: _Readers = {'karts': lambda node: node, 'heats': lambda node: node}
        fields = self._fields(root, 'the roster', parts, ('karts',))
        karts = self._karts(fields['karts']) if 'karts' in fields else []
        return karts, self._heats(fields['heats']) if 'heats' in fields else []

    def _compose(self, text: str) -> yaml.Node | None:
        try:
            with contextlib.suppress(yaml.YAMLError, ValueError, OverflowError):  # reported below
                self._refuse_cuts(text)
            return yaml.compose(text, Loader=_Loader)
        except yaml.MarkedYAMLError as error:
            raise _broken(text, error) from error
        except yaml.reader.ReaderError as error:  # a character that YAML forbids
            line = text.count('\n', 0, error.position) + 1
            reason = f'the character #x{error.character:04x} is not allowed'
            raise _not_yaml(line, reason) from error
        except RecursionError as error:
            reason = "is nested too deeply; list the karts under 'karts:'"
            raise _FaultError(0, reason) from error
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
                raise RecursionError  # early, because the scanner would become slow
            name = isinstance(token, yaml.ScalarToken) and token.plain and _is_text(token.value)
            end = token.end_mark
            if (inside or name) and _COMMENT.match(text, end.index):
                self.faults.append(_FaultError(end.line + 1, CUT))

    def _karts(self, node: yaml.Node) -> list[dict[str, Any]]:
        if not isinstance(node, yaml.SequenceNode):
            raise _fault(node, "'karts' is not a list; begin each kart with '- number: ...'")
        if not node.value:
            raise _fault(node, "'karts' is empty; list at least one kart")
        if len(node.value) > MOST_ENTRIES:
            raise _fault(
                node,
                f'lists {len(node.value)} karts; list {MOST_ENTRIES} at most, and keep the '
                'others in a roster of their own',
            )

        def own(what: str, read: _Read) -> _Read:
            right = f'give every kart its own {what}'
            return lambda node: self._once(node, what, read(node), right)

        name = functools.partial(_name, most=MAX_TRANSPONDER_LENGTH)
        readers: _Readers = {
            'number': own('number', _whole),
            'team': _team,
            'address': own('address', _address),
            'in_race': _truth,
            'inspected': _date,
            'transponders': [own('transponder', name)],
        }
        karts = []
        numbers = [_number_in(each) for each in node.value]
        for position, (number, each) in enumerate(zip(numbers, node.value, strict=True), start=1):
            kart = f'kart entry {position}' if number is None else f'kart {number}'
            needed = ('number', 'team', 'address', 'in_race')
            karts.append(self._fields(each, kart, readers, needed))
        self._numbers = {*numbers}
        return karts

    def _heats(self, node: yaml.Node) -> list[dict[str, Any]]:
        right = "write each as '  Heat 1: [1, 2, 3]'"
        if not isinstance(node, yaml.MappingNode):
            raise _fault(node, f"'heats' is not a list of names, each with its karts; {right}")
        if not node.value:
            raise _fault(node, f"'heats' is empty; {right}, or leave 'heats:' out")
        names = [self._value(key, 'heat', self._heat_name) for key, _ in node.value]
        heats = []
        for name, (_, value) in zip(names, node.value, strict=True):
            heat = 'this heat' if name is None else f'heat {name!r}'
            sources = {*names, *(each.value for each in Format)} - {name}
            readers: _Readers = {
                'karts': [functools.partial(self._member, heat=value)],
                'format': _format,
                'laps': functools.partial(_whole, most=MOST_LAPS),
                'grid_from': functools.partial(_grid_from, sources=sources),
                'auto_finish': _truth,
            }
            if isinstance(value, yaml.MappingNode):
                fields = self._fields(value, heat, readers, ('karts',))
            else:
                fields = {'karts': self._value(value, f'{heat}: karts', readers['karts'])}
            heats.append({**fields, 'name': name})
        return heats

    def _heat_name(self, node: yaml.Node) -> str:
        name = _name(node, MAX_HEAT_LENGTH)
        right = 'give every heat its own name; capitals and spaces make no difference'
        self._once(node, 'heat', ' '.join(name.casefold().split()), right)
        return name

    def _member(self, node: yaml.Node, heat: yaml.Node) -> int:
        number = _whole(node)
        if None not in self._numbers and number not in self._numbers:
            raise ValueError("is not in the roster; give a number from 'karts:'")
        return self._once(node, id(heat), number, 'give it once')

    def _once(self, node: yaml.Node, what: object, value: _Value, right: str) -> _Value:
        """Return a value of this kind, or raise a ValueError if an earlier node has it already."""
        first = self._first.setdefault((what, value), node)
        if first is not node:
            raise ValueError(f'is already in line {_line(first)}; {right}')
        return value

    def _fields(
        self,
        node: yaml.Node,
        what: str,
        readers: _Readers,
        needed: tuple[str, ...],
    ) -> dict[str, Any]:
        """Return the values in a mapping, and report those that are wrong, unknown or missing."""
        if not isinstance(node, yaml.MappingNode):
            self._note(node, f'{what} has no fields; give it {_quoted(needed)}')
            return {}
        keys: dict[str, yaml.Node] = {}
        fields: dict[str, Any] = {}
        for key, value in node.value:
            name = key.value if isinstance(key, yaml.ScalarNode) else ''
            if name not in readers:
                shown = repr(name) if name else 'that is not one word'
                known = _quoted(readers)
                self._note(key, f'{what} has the unknown field {shown}; it has {known}')
            elif (first := keys.setdefault(name, key)) is not key:
                twice = f"{what} has '{name}' already (line {_line(first)}); give it once"
                self._note(key, twice)
            else:
                fields[name] = self._value(value, f'{what}: {name}', readers[name])
        missing = [name for name in needed if name not in fields]
        if missing:
            it = 'it' if len(missing) == 1 else 'them'
            self._note(node, f'{what} has no {_quoted(missing)}; add {it}')
        return fields

    def _value(self, node: yaml.Node, what: str, read: _Read | list[_Read]) -> Any:
        """
        Return what a node contains; None if it is wrong, which is reported.

        :param what: what the node is, for the report.
        :param read: what reads the node; in a list if the node is a list of such values.
        """
        try:
            if not isinstance(read, list):
                return read(node)
            if not isinstance(node, yaml.SequenceNode) or not node.value:
                raise ValueError('is not a list; give one such as [1, 2]')
            one = what.removesuffix('s')
            return tuple(self._value(each, one, read[0]) for each in node.value)
        except ValueError as error:
            self._note(node, f'{what} {_shown(node)} {error}')
            return None

    def _note(self, where: yaml.Node, reason: str) -> None:
        self.faults.append(_fault(where, reason))


def _number_in(node: yaml.Node) -> int | None:
    """Return a kart's number, for messages about its other fields; None if it is unknown."""
    for key, value in node.value if isinstance(node, yaml.MappingNode) else ():
        if key.value == 'number':
            with contextlib.suppress(ValueError):
                return _whole(value)
    return None


_COMMENT = re.compile('[ \t]+#')

CUT = (
    "' #' begins a comment and cuts off the rest; put the text into quotes, or the comment on a "
    'line of its own'
)


def _is_text(scalar: str) -> bool:
    """Return whether a scalar may be a name, as a number, address, date or truth value is not."""
    return not re.fullmatch(r'[-.:\d]+|true|false|yes|no|on|off', scalar, re.IGNORECASE)


def _fault(where: yaml.Node | yaml.Event, reason: str) -> _FaultError:
    return _FaultError(_line(where), reason)


def _not_yaml(line: int, reason: object) -> _FaultError:
    return _FaultError(line, f'is not YAML ({reason}); compare it with config/karts.yaml')


_FIELD = re.compile(r'(?P<indent> *(?:- +)?)(?P<name>[A-Za-z_]+):(?P<glued>[^\s]?)(?P<rest>.*)')
"""A line that begins with a field, with or without a space after the colon."""

_NAMES = [each.name for kind in (Roster, RosterEntry, Heat) for each in dataclasses.fields(kind)]


def _broken(text: str, error: yaml.MarkedYAMLError) -> _FaultError:
    """Return the fault of a text that is not YAML, worded for its author."""
    mark = error.problem_mark or error.context_mark
    if mark is None:
        return _not_yaml(0, error.problem or error.context)
    lines = text.splitlines()
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
        if field and field['glued'] and field['name'] in _NAMES:
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
