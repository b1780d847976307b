# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The rehearsal: a race with simulated karts and incidents, for officials and for teams.

``plan`` is what the YAML file says, ``field`` the karts on the track, ``incidents`` what can
happen and the rule book's order, ``debrief`` what came of it. These are pure. ``event`` plays them
with the real race control over TCP. ``demo`` is a rehearsal that runs by itself.
"""
