# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Faults put into a module on purpose, for what must find them.

Each is a piece of the module's source text, and what stands in its place.
"""

from __future__ import annotations

from pathlib import Path
import sys
from types import ModuleType
from typing import NamedTuple


class Fault(NamedTuple):
    """A fault: what is put in place of what, and the rules one of which it must break."""

    old: str
    new: str
    breaks: tuple[str, ...] = ()


def source_with(module: ModuleType, old: str, new: str) -> str:
    """
    Return the source of a module with one fault.

    :raises AssertionError: if `old` is not there exactly once: the fault no longer fits.
    """
    assert module.__file__ is not None
    text = Path(module.__file__).read_text(encoding='utf-8')
    assert text.count(old) == 1, f'{text.count(old)} times in {module.__name__}: {old}'
    return text.replace(old, new)


def module_with(module: ModuleType, old: str, new: str) -> ModuleType:
    """Return a module, a second time and with one fault; see ``source_with``."""
    faulty = ModuleType(f'faulty_{module.__name__.rpartition(".")[2]}')
    text = source_with(module, old, new)
    # A dataclass looks its module up by name, while it is made.
    sys.modules[faulty.__name__] = faulty
    try:
        exec(compile(text, str(module.__file__), 'exec'), vars(faulty))  # noqa: S102
    finally:
        del sys.modules[faulty.__name__]
    return faulty
