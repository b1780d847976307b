"""The fixtures of the whole-system tests."""

from race_parts.fixtures import (  # noqa: F401 - pytest finds fixtures by name
    connect_kart,
    join_official,
    join_team,
    parts,
    start_bridge,
    start_race_control,
)
