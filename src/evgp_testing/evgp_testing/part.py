# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The base of all parts of a race."""

from __future__ import annotations

from typing import TypeVar

PATIENCE = 30.0
"""Maximum wait for anything before a test gives up, in seconds: far more than it ever takes."""

P = TypeVar('P', bound='Part')


class Part:
    """A part of a race; it releases everything in ``close`` and can be used in ``with``."""

    def close(self) -> object:
        """End the part."""
        raise NotImplementedError

    def __enter__(self: P) -> P:
        """Return the part."""
        return self

    def __exit__(self, *exc: object) -> None:
        """End the part."""
        self.close()
