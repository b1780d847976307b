# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""All commands that officials can give from a console: race control's and the timekeeper's."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeAlias

from evgp_node.entries import Entry
from evgp_node.results import Act
from evgp_rcs.rules.catalogue import CATALOGUE as OF_RACE_CONTROL
from evgp_rcs.rules.catalogue import CommandKind
from evgp_timing.corrections import CORRECTIONS

Kind: TypeAlias = CommandKind | Act

__all__ = ('CATALOGUE', 'OF_RACE_CONTROL', 'Kind')

CATALOGUE: Mapping[Kind, Entry] = dict([*OF_RACE_CONTROL.items(), *CORRECTIONS.items()])
