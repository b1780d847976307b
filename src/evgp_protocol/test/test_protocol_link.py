# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""What is said of a link: by the kernel, on a real connection, and by the pure parts of it."""

from __future__ import annotations

import socket
import struct
import time

from evgp_protocol.link import (
    Answers,
    Grade,
    grade,
    GRADES,
    make_prompt,
    parse,
    read,
    unanswered,
    unsent,
)
from hypothesis import given
from hypothesis import strategies as st
import pytest


def connection() -> tuple[socket.socket, socket.socket]:
    """Return both ends of a TCP connection on this machine."""
    with socket.create_server(('127.0.0.1', 0)) as server:
        one = socket.create_connection(server.getsockname())
        return one, server.accept()[0]


def test_the_kernel_says_how_a_connection_is() -> None:
    one, other = connection()
    with one, other:
        make_prompt(one)
        assert one.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)
        one.sendall(b'$IN_GARAGE;' * 100)
        other.recv(2000)
        until = time.monotonic() + 10
        while unanswered(one) and time.monotonic() < until:
            time.sleep(0.001)
        info = read(one)
        assert info is not None
        assert 0 < info.round_trip < 10
        assert info.since_answer < 10
        assert (info.retransmitted, unsent(one)) == (0, 0)


def test_a_closed_socket_says_nothing() -> None:
    one, other = connection()
    one.close()
    other.close()
    assert read(one) is None
    with pytest.raises((OSError, ValueError)):
        unanswered(one)


def test_each_figure_stands_where_linux_puts_it() -> None:
    data = bytearray(232)
    for at, value in ((56, 250), (68, 41_500), (100, 12), (228, 5744)):
        struct.pack_into('=I', data, at, value)
    info = parse(bytes(data))
    assert info is not None
    assert (info.window, parse(bytes(data[:228])).window) == (5744, None)
    assert (info.since_answer, info.round_trip, info.retransmitted) == (0.25, 0.0415, 12)


@given(st.binary(max_size=400))
def test_a_struct_of_another_kernel_is_no_error(data: bytes) -> None:
    assert (parse(data) is None) == (len(data) < 136)


@pytest.mark.parametrize(
    ('worst', 'found'),
    [
        (None, Grade.UNKNOWN),
        (0.0, Grade.GOOD),
        (0.199, Grade.GOOD),
        (0.2, Grade.FAIR),
        (0.499, Grade.FAIR),
        (0.5, Grade.POOR),
        (1e9, Grade.POOR),
    ],
)
def test_the_grade_goes_by_the_worst_round_trip(worst: float | None, found: Grade) -> None:
    assert grade(worst) is found


def test_every_grade_but_unknown_has_its_figure_and_they_rise() -> None:
    assert [*GRADES] == [each for each in Grade if each is not Grade.UNKNOWN]
    assert sorted(GRADES.values()) == [*GRADES.values()]


@given(
    st.lists(st.tuples(st.integers(1, 32), st.floats(0, 1), st.floats(0, 1)), max_size=30),
    st.data(),
)
def test_each_frame_is_answered_once_and_in_order(
    frames: list[tuple[int, float, float]], data: st.DataObject
) -> None:
    answers, now, written, trips = Answers(), 0.0, [], list[float]()
    for size, pause, look in frames:
        now += pause
        answers.wrote(size, now)
        written.append((answers.written, now))
        now += look
        left = data.draw(st.integers(0, answers.written - answers.answered))
        seen = answers.look(left, now)
        expected = [at for end, at in written if end <= answers.written - left]
        del expected[: len(trips)]
        assert seen == [now - at for at in expected]
        trips += seen
        still = [at for end, at in written if end > answers.answered]
        assert answers.age(now) == (now - still[0] if still else 0.0)


def test_a_link_that_answers_late_is_sent_less() -> None:
    answers = Answers()
    answers.wrote(10, 0.0)
    answers.look(0, 0.05)
    answers.wrote(10, 0.1)
    assert answers.may_beat(0.15)
    answers.wrote(10, 0.3)
    assert answers.may_beat(0.36)  # 0.26 s unanswered: each beat
    answers.wrote(10, 0.5)
    assert not answers.may_beat(0.59)  # 0.49 s unanswered: each second one
    assert answers.may_beat(0.66)


def test_a_long_way_is_no_reason_to_send_less() -> None:
    answers = Answers()
    answers.wrote(10, 0.0)
    answers.look(0, 0.6)
    answers.wrote(10, 0.65)
    assert answers.may_beat(1.2)
    answers.wrote(10, 1.2)
    assert answers.may_beat(1.25)
