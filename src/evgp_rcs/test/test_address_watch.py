# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""What the watch of race control's address asks, and what it makes of what it sees and hears."""

from __future__ import annotations

from collections.abc import Sequence
import functools
import ipaddress

from evgp_node.graph import EVERY
from evgp_node.network_cards import Card, LOOPBACK_CARD
from evgp_rcs.karts.address_watch import (
    ANNOUNCEMENTS,
    ASK_EVERY,
    Claim,
    claim_in,
    HEARD_WITHIN,
    Lookout,
    packet,
    to_be_asked,
)
from hypothesis import given, strategies
import pytest

OWN, OTHER = '02:00:00:00:00:01', '02:00:00:00:00:02'
ADDRESS = '10.0.0.1'
KARTS = ('10.0.0.101', '10.0.0.102')


def card(name: str, *addresses: str, number: int = 2, **fields: object) -> Card:
    """Return an interface that is plugged in."""
    return Card(
        name, number, OWN, True, 0, tuple(map(ipaddress.IPv4Interface, addresses))
    )._replace(**fields)  # type: ignore[arg-type]


ETH0 = card('eth0', '10.0.0.1/24')
LO = card(LOOPBACK_CARD, '127.0.0.1/8', number=1, hardware='00:00:00:00:00:00')


def lookout(*there: Card, host: str = ADDRESS, at: float = 0.0) -> Lookout:
    """Return the watch of an address, which has seen these interfaces once."""
    watch = Lookout(functools.partial(to_be_asked, host, KARTS))
    watch.see(there, at)
    return watch


def see_until(watch: Lookout, there: Sequence[Card], began: float, ends: float) -> None:
    """Have a watch see the same interfaces for some time."""
    steps = int((ends - began) / 0.1)
    for at in range(1, steps + 1):
        watch.see(there, began + at * 0.1)


# ----- packets --------------------------------------------------------------------------------


def test_a_question_names_nobody_as_its_sender_and_an_announcement_names_this_machine() -> None:
    assert claim_in('eth0', packet(OWN, '0.0.0.0', ADDRESS)) == Claim('eth0', '0.0.0.0', OWN)
    assert claim_in('eth0', packet(OWN, ADDRESS, ADDRESS)) == Claim('eth0', ADDRESS, OWN)


@given(data=strategies.binary(max_size=80))
def test_a_packet_of_any_bytes_is_read_or_is_none(data: bytes) -> None:
    found = claim_in('eth0', data)
    assert found is None or found.interface == 'eth0'


# ----- where is asked -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('host', 'there', 'asked'),
    [
        (ADDRESS, [LO, ETH0, card('eth1', '10.0.0.2/24')], [('eth0', ADDRESS)]),
        (ADDRESS, [LO], []),
        (EVERY, [LO, ETH0, card('eth1', '10.1.0.5/24')], [('eth0', ADDRESS)]),
        (EVERY, [ETH0, card('wlan0', '10.0.0.7/16')], [('eth0', ADDRESS), ('wlan0', '10.0.0.7')]),
        (EVERY, [LO, card('eth0', '192.0.2.1/24')], []),
        ('127.0.0.1', [LO, ETH0], []),
    ],
)
def test_race_control_asks_for_its_own_address_wherever_karts_of_the_roster_reach_it(
    host: str, there: list[Card], asked: list[tuple[str, str]]
) -> None:
    found = to_be_asked(host, (*KARTS, '127.0.1.1'), there)
    assert [(each.card.name, each.address) for each in found] == asked


def test_it_asks_at_once_and_then_again_and_again_and_announces_once_nobody_answers() -> None:
    watch = lookout(ETH0)
    asked = [watch.due(step * ASK_EVERY) for step in range(20)]
    assert all(len(each) == 1 for each in asked)
    announced = [announce for ((_, announce),) in asked]
    before = int(HEARD_WITHIN / ASK_EVERY)
    assert announced == [*[False] * before, *[True] * ANNOUNCEMENTS][:20] + [False] * (
        20 - before - ANNOUNCEMENTS
    )
    assert watch.due(19 * ASK_EVERY) == []
    assert len(watch.due(1000.0)) == 1  # what was not asked meanwhile is not made up for
    assert watch.due(1000.0) == []


# ----- what is heard --------------------------------------------------------------------------


def test_whoever_else_claims_the_address_at_that_interface_has_it_and_is_named() -> None:
    watch = lookout(ETH0, card('eth1', '10.1.0.5/24', number=3))
    assert watch.hear(Claim('eth0', '10.0.0.9', OTHER)) == ''
    assert watch.hear(Claim('eth1', ADDRESS, OTHER)) == ''  # another network
    found = watch.hear(Claim('eth0', ADDRESS, OTHER))
    assert OTHER in found
    assert ADDRESS in found
    assert 'eth0' in found


def test_the_interfaces_of_this_machine_are_nobody_else_not_even_one_that_has_just_gone() -> None:
    second = card('eth1', '10.0.0.2/24', number=3, hardware=OTHER)
    watch = lookout(ETH0, second)
    assert watch.hear(Claim('eth0', ADDRESS, OTHER)) == ''
    watch.see([ETH0], 0.2)
    assert watch.hear(Claim('eth0', ADDRESS, OTHER)) == ''
    watch.see([ETH0], 0.4)
    assert watch.hear(Claim('eth0', ADDRESS, OTHER)) != ''


def test_a_first_answer_of_this_machine_that_may_hide_another_ones_is_not_to_know() -> None:
    watch = lookout(ETH0, card('eth1', '10.0.0.2/24', number=3, hardware=OTHER))
    assert watch.not_known == ''
    assert watch.hear(Claim('eth0', ADDRESS, OTHER, alone=True)) == ''
    assert 'arping' in watch.not_known


@pytest.mark.parametrize(
    'there',
    [[], [LO], [ETH0._replace(plugged=False)], [ETH0._replace(hardware='')]],
    ids=['no interface', 'only loopback', 'no cable', 'no ARP'],
)
def test_where_nobody_can_be_asked_it_is_not_known_who_has_the_address(there: list[Card]) -> None:
    watch = lookout(*there)
    assert watch.not_known != ''
    assert watch.due(0.0) == []
    assert watch.cut_off == ''  # it was never there


# ----- what is lost ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('after', 'why'),
    [
        ([LO], 'gone'),
        ([ETH0._replace(plugged=False)], 'cable'),
        ([ETH0._replace(losses=1)], 'cable'),  # pulled and plugged in between two looks
        ([ETH0._replace(number=9)], 'cable'),
        ([ETH0._replace(addresses=())], ADDRESS),
    ],
)
@pytest.mark.parametrize('host', [ADDRESS, EVERY])
def test_a_cable_an_interface_or_an_address_that_is_lost_cuts_race_control_off_until_it_is_back(
    host: str, after: list[Card], why: str
) -> None:
    watch = lookout(ETH0, host=host)
    watch.see([ETH0], 0.1)
    assert watch.cut_off == ''

    watch.see(after, 0.2)
    assert watch.cut_off != ''
    assert why in watch.cut_off

    back = [ETH0._replace(number=10, losses=2)]
    watch.see(back, 0.3)
    assert len(watch.due(0.3)) == 1  # it is asked at once
    see_until(watch, back, 0.3, 0.3 + HEARD_WITHIN - 0.1)
    assert watch.cut_off != ''
    see_until(watch, back, 0.3 + HEARD_WITHIN - 0.1, 0.3 + HEARD_WITHIN + 0.2)
    assert watch.cut_off == ''


def test_a_lost_address_is_followed_to_an_interface_of_another_name() -> None:
    watch = lookout(ETH0)
    watch.see([LO], 0.2)
    usb = card('enx02', '10.0.0.1/24', number=7)
    watch.see([usb], 0.4)
    assert [each.card.name for each, _ in watch.due(0.4)] == ['enx02']
    see_until(watch, [usb], 0.4, 0.4 + HEARD_WITHIN + 0.2)
    assert watch.cut_off == ''


def test_a_roster_that_was_corrected_cuts_nobody_off() -> None:
    karts = [*KARTS, '192.0.2.103']
    watch = Lookout(functools.partial(to_be_asked, EVERY, karts))
    there = (ETH0, card('wlan0', '192.0.2.1/24', number=3))
    watch.see(there, 0.0)
    assert len(watch.asked) == 2
    karts[-1] = '10.0.0.103'
    watch.see(there, 0.2)
    assert (len(watch.asked), watch.cut_off) == (1, '')


def test_what_karts_do_not_use_may_come_and_go() -> None:
    officials = card('eth1', '10.1.0.5/24', number=3)
    for host in (ADDRESS, EVERY):
        watch = lookout(ETH0, officials, host=host)
        watch.see([ETH0, officials._replace(plugged=False)], 0.2)
        watch.see([ETH0], 0.4)
        assert watch.cut_off == ''
