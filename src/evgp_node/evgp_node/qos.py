# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The QoS of topics that several of our nodes use."""

from __future__ import annotations

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy


def _reliable(depth: int, durability: DurabilityPolicy) -> QoSProfile:
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=durability,
    )


def volatile(depth: int) -> QoSProfile:
    """Return the QoS of reliable messages, the last `depth` of which wait to be delivered."""
    return _reliable(depth, DurabilityPolicy.VOLATILE)


def latched(depth: int) -> QoSProfile:
    """Return the QoS of a topic whose last `depth` messages also reach late subscribers."""
    return _reliable(depth, DurabilityPolicy.TRANSIENT_LOCAL)


DIAGNOSTICS_QOS = volatile(10)
"""QoS of ``/diagnostics``, as its usual readers expect it."""
