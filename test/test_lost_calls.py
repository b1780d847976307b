# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""An official's call, and its answer, on a network that loses them."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
import contextlib
import pathlib
import socket
import time

from evgp_node import graph
from evgp_testing.domains import Domain
from evgp_testing.official import Official
from evgp_testing.race_control import RaceControl
import pytest
from rig.networks import need_networks, RACE_CONTROL, Track

DESK = '10.77.0.2'

OUTAGE = 0.3
"""How long everything in one direction is lost, s."""

SOON = 2.0
"""How soon after the outage the official must be answered, s: less than the 3 s after which Fast
DDS, by its defaults, asks whether anything was lost."""


@pytest.mark.own_process
def test_what_the_officials_network_loses_of_a_stop_is_sent_again_at_once(
    parts: contextlib.ExitStack, domain: int, tmp_path: pathlib.Path
) -> None:
    need_networks()
    track = parts.enter_context(Track())
    own, desk = track.machine('own', RACE_CONTROL), track.machine('desk', DESK)
    with own.inside(), pytest.MonkeyPatch.context() as patch:
        patch.setenv(graph.INTERFACE, own.address)
        parts.enter_context(RaceControl(tmp_path, domain, in_race=[1]))
    with desk.inside(), pytest.MonkeyPatch.context() as patch:
        patch.setenv(graph.INTERFACE, desk.address)
        official = parts.enter_context(Official(domain))
    official.command('all_kill')
    with ThreadPoolExecutor(1) as caller:
        for lost in ('back', 'toward') * 3:  # the call, and the answer
            desk.air(**{lost: 1.0})
            answer = caller.submit(official.call, 'all_kill')
            time.sleep(OUTAGE)
            assert not answer.done()
            until = desk.air() + SOON
            assert answer.result().success
            assert time.monotonic() < until


def test_a_large_race_leaves_room_for_an_answer_in_every_socket_of_the_graph() -> None:
    allowed = int(pathlib.Path('/proc/sys/net/core/rmem_max').read_text(encoding='ascii'))
    asked = min(graph.RECEIVE_BUFFER_BYTES, allowed)
    with Domain() as domain, Official(domain.number), graph.udp_sockets() as found:
        first = 7400 + 250 * domain.number
        kept = [
            each.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)
            for each in found
            if each.getsockname()[1] in range(first, first + 250)
        ]
    assert len(kept) >= 2  # for what DDS itself says, and for the rest
    assert min(kept) >= 2 * asked  # the kernel doubles it, for what it needs itself
