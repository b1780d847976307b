"""
The rehearsal: a race with simulated karts and incidents, for officials and for teams.

``plan`` is what the YAML file says, ``field`` the karts on the track, ``incidents`` what can
happen and what a good official does, ``score`` the sheet. These are pure. ``table_top`` plays
them with the rules in this process, in no time; ``event`` with the real race control over TCP.
``demo`` is a rehearsal that runs by itself, and ``findings``, which is pure, judges its races.
"""
