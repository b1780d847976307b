# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""A race of plain karts: race control, an official, and karts that acknowledge each change."""

from __future__ import annotations

from collections.abc import Collection, Mapping
import contextlib
import pathlib
from typing import Any

from evgp_protocol.states import RaceState
from evgp_testing.domains import Domain
from evgp_testing.official import Official
from evgp_testing.part import Part
from evgp_testing.race_control import address_of, RaceControl
from evgp_testing.wire_kart import WireKart


class WireRace(Part):
    """
    Race control, an official, and a plain kart for each number except the absent ones.

    ``karts`` lists those in the race first.

    :param folder: the folder for race control's files.
    :param racing: the numbers of the karts in the race.
    :param others: the numbers of the karts that are only in the roster.
    :param absent: the numbers of roster karts that do not connect.
    :param parameters: more ROS parameters of race control.
    :param more: further arguments of ``RaceControl``, such as its heats.
    """

    def __init__(
        self,
        folder: pathlib.Path,
        racing: Collection[int],
        others: Collection[int] = (),
        absent: Collection[int] = (),
        parameters: Mapping[str, object] | None = None,
        **more: Any,
    ) -> None:
        self.racing = tuple(racing)
        present = [number for number in (*racing, *others) if number not in absent]
        with contextlib.ExitStack() as stack:
            self.domain = stack.enter_context(Domain()).number
            self.control = stack.enter_context(
                RaceControl(folder, self.domain, racing, others, parameters, **more)
            )
            self.official = stack.enter_context(Official(self.domain))
            self.karts = [
                stack.enter_context(
                    WireKart(address_of(number), self.control.port, acknowledges=True)
                )
                for number in present
            ]
            self.official.wait_for_connected(*present)
            self._stack = stack.pop_all()

    def bring_to(self, state: RaceState) -> None:
        """Bring the race to a state, from whatever state it is in; see ``Official.bring_to``."""
        self.official.bring_to(state, *self.racing)

    def close(self) -> None:
        self._stack.close()
