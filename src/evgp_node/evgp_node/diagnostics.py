# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The QoS with which our nodes publish diagnostics."""

from __future__ import annotations

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

DIAGNOSTICS_QOS = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=10,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.VOLATILE,
)
"""QoS of ``/diagnostics``, as diagnostic aggregators expect it."""
