# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The limits of an inspection or a survey.

Each limit is an option of the command line, and every report lists the limits used.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
import dataclasses
import math
import os
import pathlib
from typing import TypeVar

from evgp_inspection import VERSION
from evgp_protocol.frames import DEFAULT_PORT
from evgp_protocol.link import Grade, GRADES

AnyLimits = TypeVar('AnyLimits', bound='_Limits')


def _limit(default: float, meaning: str) -> float:
    value: float = dataclasses.field(default=default, metadata={'meaning': meaning})
    return value


class _Limits:
    """
    The base of all limits, which are in seconds unless their meaning names another unit.

    The meaning of each limit is in the metadata of its field, for the command line.

    :raises ValueError: if a limit is not a finite number above 0; ``warning``, ``hold`` and
        ``seed`` may also be 0.
    """

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):  # type: ignore[arg-type]
            value = getattr(self, field.name)
            least = 0.0 if field.name in ('warning', 'hold', 'seed') else math.ulp(0.0)
            if not (math.isfinite(value) and value >= least):
                raise ValueError(f'{field.name} must be a finite number above 0, not {value!r}')

    @classmethod
    def parse(
        cls: type[AnyLimits],
        parser: argparse.ArgumentParser,
        arguments: Sequence[str] | None,
        folder: str,
    ) -> tuple[argparse.Namespace, AnyLimits]:
        """
        Read a command line with the options of both programs, and one for each limit.

        :param folder: the default folder for reports.
        :return: the options and the limits.
        """
        add = parser.add_argument
        add('--version', action='version', version=VERSION)
        add('--listen', metavar='ADDRESS', default='0.0.0.0', help='own address (%(default)s)')
        add('--port', type=int, default=DEFAULT_PORT, help='port for karts (%(default)s)')
        meaning = 'folder for the reports (%(default)s); if empty, there is no report'
        add('--report', metavar='FOLDER', default=folder, help=meaning)
        group = parser.add_argument_group('limits, in seconds unless stated otherwise')
        fields = dataclasses.fields(cls)  # type: ignore[arg-type]
        for field in fields:
            group.add_argument(
                f'--{field.name.replace("_", "-")}',
                type=float,
                default=field.default,
                metavar='X',
                help=f'{field.metadata["meaning"]} (%(default)s)',
            )
        options = parser.parse_args(arguments)
        # Whoever finds this out at the end has lost the report.
        report = pathlib.Path(options.report).absolute()
        parent = next(each for each in (report, *report.parents) if each.exists())
        if options.report and not (parent.is_dir() and os.access(parent, os.W_OK)):
            parser.error(f'--report {options.report}: {parent} is no folder that you may write to')
        try:
            return options, cls(**{field.name: getattr(options, field.name) for field in fields})
        except ValueError as error:
            parser.error(str(error))


@dataclasses.dataclass(frozen=True)
class Limits(_Limits):
    """The limits of `inspect_kart`."""

    connect: float = _limit(120.0, 'maximum time until the kart connects for the first time')
    grid: float = _limit(120.0, 'maximum time to acknowledge GRID_ACTIVE')
    green: float = _limit(30.0, 'maximum time to acknowledge GREEN_GREEN and to start driving')
    red_flag: float = _limit(15.0, 'maximum time to stand still and acknowledge RED_FLAG')
    red_red: float = _limit(5.0, 'maximum time to stand still and acknowledge RED_RED')
    silence: float = _limit(1.0, 'time without frames after which the kart must stop')
    reconnect: float = _limit(10.0, 'maximum time to reconnect after a loss')
    away: float = _limit(10.0, 'how long a restarting race control is away')
    drive: float = _limit(2.0, 'how long the kart drives before each stop')
    watch: float = _limit(1.5, 'how long the kart is watched while it must do nothing')
    slack: float = _limit(0.5, 'delay allowed for odometry, network and reaction')
    fastest_stop: float = _limit(0.1, 'minimum time that a kart at speed needs to stop')
    harder: float = _limit(0.8, 'maximum time of a RED_RED stop, as a fraction of a RED_FLAG stop')
    long: float = _limit(60.0, 'how long the kart drives once without a break')
    dwell: float = _limit(10.0, 'how long each state is sent to a standing kart')
    seed: float = _limit(0.0, 'seed for the times of random stops; 0 means a random seed')
    fast: float = _limit(3.0, 'how long 100 frames a second are sent')
    answer: float = _limit(20.0, 'maximum time to wait for an answer from the inspector')
    warning: float = _limit(1.0, 'time between the announcement and the start of a drive')
    hold: float = _limit(3.0, 'how long RED_RED is sent at the end')
    standstill: float = _limit(0.05, 'maximum speed of a kart that stands still, m/s')


@dataclasses.dataclass(frozen=True)
class SurveyLimits(_Limits):
    """The limits of `survey_network`; no connection may be lost."""

    round_trip: float = _limit(
        GRADES[Grade.FAIR], 'maximum round trip of 99 of 100 frames, even if each is lost once'
    )
    silence: float = _limit(
        GRADES[Grade.POOR], 'maximum time without an answer; half of what stops a kart'
    )
    retransmissions: float = _limit(
        36.0, 'maximum number of retransmissions in any minute; a twentieth of the frames'
    )
    shortest: float = _limit(60.0, 'minimum time on the network for a verdict')
