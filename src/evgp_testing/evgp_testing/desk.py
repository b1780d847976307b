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

"""An official at a desk of their own: a network between them and race control's machine."""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
import os
import pathlib

from evgp_node import graph
from evgp_testing.domains import Domain
from evgp_testing.networks import Machine, RACE_CONTROL, Track
from evgp_testing.official import Official
from evgp_testing.race_control import RaceControl
from evgp_testing.ros_side import environment_kept

DESK = '10.77.0.2'


@contextlib.contextmanager
def official_at_a_desk(folder: pathlib.Path, seed: int = 0) -> Iterator[tuple[Official, Machine]]:
    """
    Start race control and an official on two machines; yield the official and their machine.

    For a process that has not used ROS yet: Fast DDS looks for the networks only once.

    :param folder: where race control's files are written.
    :param seed: of the dice that decide what the network loses.
    :raises NetworkError: if this machine does not let us make networks.
    """
    with Domain() as domain, Track(seed) as track, contextlib.ExitStack() as parts:
        own, desk = track.machine('own', RACE_CONTROL), track.machine('desk', DESK)
        for machine in (own, desk):
            machine.ip('route add 239.0.0.0/8 dev eth0')  # by which the two find each other
        with own.inside(), environment_kept():
            os.environ[graph.INTERFACE] = own.address
            parts.enter_context(RaceControl(folder, domain.number, in_race=[1]))
        with desk.inside(), environment_kept():
            os.environ[graph.INTERFACE] = desk.address
            official = parts.enter_context(Official(domain.number))
        yield official, desk
