# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""What race control says of its own health on ``/diagnostics``, and of its record."""

from __future__ import annotations

import contextlib
import pathlib
import sqlite3

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from evgp_protocol.link import Grade
from evgp_protocol.states import RaceState
from evgp_rcs_msgs import msg
from evgp_testing.fixtures import ConnectKart, JoinOfficial, StartBridge, StartRaceControl
from evgp_testing.race_control import address_of
from evgp_testing.ros_side import RosSide

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR


class Health(RosSide):
    """Whoever looks at the diagnostics."""

    def __init__(self, domain: int) -> None:
        super().__init__('health', domain)
        self._arrays = self.hear(DiagnosticArray, '/diagnostics')
        self.spin()

    @property
    def statuses(self) -> dict[str, DiagnosticStatus]:
        """Return the newest statuses by their names."""
        return {each.name: each for array in self._arrays[-1:] for each in array.status}

    def wait_for(self, name: str, level: bytes, **having: str) -> DiagnosticStatus:
        """Return the status of this name as soon as it has this level and these values."""

        def found() -> DiagnosticStatus | None:
            status = self.statuses.get(name)
            fits = status and status.level == level and having.items() <= values(status).items()
            return status if fits else None

        return self.wait_until(found, lambda: f'{name}: {level!r}, {having}; {self.statuses}')


def values(status: DiagnosticStatus) -> dict[str, str]:
    return {each.key: each.value for each in status.values}


def test_diagnostics_have_every_kart_and_the_level_and_text_of_the_gravest_alert(
    start_race_control: StartRaceControl,
    join_official: JoinOfficial,
    connect_kart: ConnectKart,
    parts: contextlib.ExitStack,
    tmp_path: pathlib.Path,
) -> None:
    record = tmp_path / 'record.sqlite3'
    control = start_race_control(in_race=[1], others=[2], red_alert=0.1, record=record)
    official, health = join_official(control), parts.enter_context(Health(control.domain))
    missing = health.wait_for('rcs: kart 1', WARN)
    assert (missing.hardware_id, values(missing)['team']) == (address_of(1), 'Team 1')
    health.wait_for('rcs: kart 2', OK)  # it is not in the race
    assert {*health.statuses} == {'rcs: race', 'rcs: kart 1', 'rcs: kart 2'}
    health.wait_for('rcs: race', OK)

    with contextlib.closing(sqlite3.connect(record, isolation_level=None)) as other:
        other.execute('BEGIN IMMEDIATE')  # nobody else can write the file now
        official.command('set_track_open', open=False)  # something to be written
        race = official.wait_for_race(lambda race: race.alerts, 'an alert')
        (alert,) = race.alerts
        assert (alert.kind, alert.use_msr) == (msg.Alert.RECORD_FAILING, False)
        assert str(record) in alert.text
        status = health.wait_for('rcs: race', ERROR)
        assert str(record) in status.message
        assert values(status)['alerts'] == '1'
    official.wait_for_race(lambda race: not race.alerts, 'the end of the alert')

    kart = connect_kart(control, 1, acknowledges=True)
    official.wait_for_connected(1)
    health.wait_for('rcs: kart 1', OK)
    status = health.wait_for('rcs: race', OK)
    assert (status.hardware_id, values(status)['race state']) == ('rcs', 'IN_GARAGE')
    official.command('grid_active', track_clear=True)
    kart.close()
    race = official.wait_for_race(lambda race: race.alerts, 'an alert')
    assert {each.kind for each in race.alerts} == {msg.Alert.KART_LOST}
    assert health.wait_for('rcs: race', WARN).message == race.alerts[0].text

    kart = connect_kart(control, 1)  # it acknowledges nothing any more
    official.wait_for_connected(1)
    official.command('all_kill')
    race = official.wait_for_race(
        lambda race: any(each.use_msr for each in race.alerts), 'an alert to use the MSR'
    )
    gravest = [each.text for each in race.alerts if each.use_msr]
    assert health.wait_for('rcs: race', ERROR).message.endswith(tuple(gravest))
    kart.close()

    connect_kart(control, 1, acknowledges=True)
    official.wait_for_acks(RaceState.RED_RED, 1)
    race = official.wait_for_race(lambda race: race.karts[0].link.grade, 'a measured link')
    link = race.karts[0].link
    shown = {'link': list(Grade)[link.grade].value, 'retransmitted': str(link.retransmitted)}
    told = {'team': 'Team 1', 'sent': 'RED_RED', 'acknowledged': 'true', **shown}
    health.wait_for('rcs: kart 1', OK, **told)


def test_a_bridge_that_hears_no_race_control_has_an_error_in_its_only_status(
    start_bridge: StartBridge, parts: contextlib.ExitStack
) -> None:
    bridge = start_bridge()
    health = parts.enter_context(Health(bridge.domain))
    status = health.wait_for('kart_bridge: race state', ERROR)
    assert values(status)['odometry'] == 'not heard on /kart_bridge/odom'
    assert [*health.statuses] == ['kart_bridge: race state']
