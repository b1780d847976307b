# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The base of all parts of a race."""

from __future__ import annotations

from typing import TypeVar

PATIENCE = 30.0
"""Time for which a test waits for anything before it gives up, in seconds. It is far longer than
anything ever takes."""

P = TypeVar('P', bound='Part')


class Part:
    """A part of a race, which releases everything in ``close`` and can be used in ``with``."""

    def close(self) -> object:
        raise NotImplementedError

    def __enter__(self: P) -> P:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()
