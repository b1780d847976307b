# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""An event loop on the clock that stops karts. Programs without one need not load asyncio."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import Any, TypeVar

from evgp_protocol.clock import now

T = TypeVar('T')


class BoottimeEventLoop(asyncio.SelectorEventLoop):
    """
    An event loop whose time is `now`, so its deadlines and timeouts include suspend.

    The kernel wakes the loop by the monotonic clock. After a suspend, the loop therefore handles
    an expired deadline only when it next wakes, at the latest after the rest of its wait. A loop
    that must act soon after a suspend needs something that wakes it often.
    """

    def time(self) -> float:
        return now()


def run(main: Coroutine[Any, Any, T]) -> T:
    """Run a coroutine on its own `BoottimeEventLoop`, but handle no signals."""
    # Only a kart with Humble has an older Python than 3.11, and it has no such loop.
    with asyncio.Runner(loop_factory=BoottimeEventLoop) as runner:  # type: ignore[attr-defined]
        result: T = runner.get_loop().run_until_complete(main)
        return result
