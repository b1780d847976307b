# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The rehearsal: a race with simulated karts and incidents, for officials and for teams.

``plan`` is what is rehearsed, and ``field`` simulates the karts on the track. ``incidents`` lists
what can happen and what the rule book then orders, and ``debrief`` reports what happened. These
modules are pure. ``event`` runs them with the real race control over TCP. ``demo`` is a rehearsal
without people.
"""
