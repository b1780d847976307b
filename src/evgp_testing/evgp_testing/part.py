# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""What the parts of a race have in common."""

from __future__ import annotations

from typing import TypeVar

PATIENCE = 30.0
"""How long anything is awaited before a test gives up, seconds: far more than it ever takes."""

P = TypeVar('P', bound='Part')


class Part:
    """A part of a race, which gives everything back in ``close``; it can be used in ``with``."""

    def close(self) -> object:
        """End it."""
        raise NotImplementedError

    def __enter__(self: P) -> P:
        """Return it."""
        return self

    def __exit__(self, *exc: object) -> None:
        """End it."""
        self.close()
