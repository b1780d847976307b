# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""A race as an animated picture (SVG), seen from above. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
import itertools
import math

from centreline import Centreline
from evgp_protocol.states import RaceState

COLOURS = {
    RaceState.IN_GARAGE: '#5e676f',
    RaceState.GRID_ACTIVE: '#f2c200',
    RaceState.GREEN_GREEN: '#0a7d3e',
    RaceState.RED_FLAG: '#f08a00',
    RaceState.RED_RED: '#b3001b',
}
"""The colours of the officials' window."""

SCALE = 14.0
"""Units of the picture per metre."""

PACE = 3.0
"""Speed of the picture relative to the race."""


@dataclass(frozen=True)
class Look:
    """
    The race at one moment.

    :param karts: for each kart x, y (m), heading (rad), the state it is sent, and its laps.
    """

    state: RaceState
    karts: Mapping[int, tuple[float, float, float, RaceState, int]]


def draw(
    track: Centreline, looks: Sequence[Look], teams: Mapping[int, str], interval: float
) -> str:
    """
    Return the picture, which plays in a loop.

    :param interval: time between two looks, in seconds.
    """
    duration = f'{len(looks) * interval / PACE:.1f}s'
    xs, ys = zip(*track.points, strict=True)
    width = (max(xs) - min(xs) + 8) * SCALE
    height = (max(ys) - min(ys) + 17) * SCALE

    def at(x: float, y: float) -> str:
        return f'{(x - min(xs) + 4) * SCALE:.0f},{(max(ys) - y + 13) * SCALE:.0f}'

    def over_time(attribute: str, values: Sequence[str]) -> str:
        """Return the animation of an attribute, by its value in each look."""
        changes = [at for at, new in enumerate(values) if at == 0 or new != values[at - 1]]
        times = ';'.join(f'{index / len(looks):.4f}' for index in changes)
        listed = ';'.join(values[index] for index in changes)
        return (
            f'<animate attributeName="{attribute}" dur="{duration}" repeatCount="indefinite" '
            f'calcMode="discrete" keyTimes="{times}" values="{listed}"/>'
        )

    def shown(where: Iterable[bool]) -> str:
        return over_time('visibility', ['visible' if each else 'hidden' for each in where])

    def sent(number: int) -> str:
        return over_time('fill', [COLOURS[look.karts[number][3]] for look in looks])

    def kart(number: int) -> str:
        values = ';'.join(at(*look.karts[number][:2]) for look in looks)
        turns = ';'.join(f'{-math.degrees(look.karts[number][2]):.0f}' for look in looks)
        timed = f'dur="{duration}" repeatCount="indefinite"'
        return (
            f'<g><animateTransform attributeName="transform" type="translate" {timed} '
            f'values="{values}"/><g><animateTransform attributeName="transform" type="rotate" '
            f'{timed} values="{turns}"/><rect x="-17" y="-10" width="34" height="20" rx="5" '
            f'stroke="#111" stroke-width="2">{sent(number)}</rect></g>'
            f'<text y="5" text-anchor="middle" font-size="15" font-weight="bold" fill="#fff" '
            f'stroke="#111" stroke-width="3" paint-order="stroke">{number}</text></g>'
        )

    line = ' '.join(itertools.starmap(at, track.points))
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height:.0f}" '
        'font-family="DejaVu Sans, Verdana, sans-serif">',
        f'<rect width="{width:.0f}" height="{height:.0f}" fill="#f3f5ef"/>',
        f'<rect width="{width:.0f}" height="64">',
        over_time('fill', [COLOURS[look.state] for look in looks]),
        '</rect>',
    ]
    for state in RaceState:
        if any(look.state is state for look in looks):
            dark = state in (RaceState.GRID_ACTIVE, RaceState.RED_FLAG)
            parts.append(
                f'<text x="24" y="44" font-size="34" font-weight="bold" '
                f'fill="{"#111" if dark else "#fff"}" visibility="hidden">'
                f'{state.value.replace("_", " ")}'
                f'{shown(look.state is state for look in looks)}</text>'
            )
    for stroke, colour in ((track.width + 0.6, '#555'), (track.width, '#b9bcb4')):
        parts.append(
            f'<polygon points="{line}" fill="none" stroke="{colour}" stroke-linejoin="round" '
            f'stroke-width="{stroke * SCALE:.0f}"/>'
        )
    across = at(0.0, track.width / 2), at(0.0, -track.width / 2)
    parts.append(f'<polyline points="{" ".join(across)}" stroke="#fff" stroke-width="5"/>')
    for column, (number, team) in enumerate(teams.items()):
        left = f'y="100" x="{24 + column * width / len(teams):.0f}"'
        box = f'<rect transform="translate(0,-16)" {left} width="20" height="20">'
        parts.append(f'{box}{sent(number)}</rect>')
        for laps in range(max(look.karts[number][4] for look in looks) + 1):
            text = f'{number} {escape(team)}: {laps} {"lap" if laps == 1 else "laps"}'
            where = f'dx="30" {left} font-size="19" visibility="hidden"'
            now = shown(look.karts[number][4] == laps for look in looks)
            parts.append(f'<text {where}>{text}{now}</text>')
    parts += [kart(number) for number in reversed([*teams])]
    return '\n'.join([*parts, '</svg>\n'])
