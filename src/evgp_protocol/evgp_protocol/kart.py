# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
A kart without ROS: the bytes that came and the time in, what to obey and what to send out.

No socket, clock, thread or log lives here, and no rule: the rules are the arbiter's, the frames
the decoder's. In each turn of a kart's loop, at least 20 times a second::

    kart.tick(now)                          # first of all: is race control silent?
    kart.received(data, now)                # all that has come
    verdict = kart.verdict
    if not kart.is_open:
        ...                                 # close the socket, if any, and connect again later
    if drive(verdict.state, verdict.may_drive):
        send(kart.acknowledge(verdict.order, now))

and, when they happen, `Kart.connected` and `Kart.closed`. ``drive`` must not wait, and returns
whether the kart *has* reached the state. ``kit/python/example.py`` is a whole program;
``kit/c/evgp_kart.h`` is the same in C.
"""

from __future__ import annotations

from evgp_protocol.arbiter import Arbiter, Outcome, Settings, StopSource, Verdict
from evgp_protocol.frames import encode, FrameDecoder, StateFrame
from evgp_protocol.states import RaceState


class Kart:
    """
    One kart, and its connection to race control. It has one owner.

    Every input brings its time, in seconds, of a clock that nobody sets and that goes on in a
    suspend: `evgp_protocol.clock.now`. A time before an earlier one is doubt: the connection is
    lost.

    :ivar malformed: how many malformed frames have come so far.
    """

    def __init__(self, settings: Settings | None = None) -> None:
        self.malformed = 0
        self._arbiter = Arbiter(settings or Settings(), first_order=1)
        self._decoder: FrameDecoder | None = None  # of the present connection, if there is one
        self._said_order = 0
        self._heard_since_said = False
        # IN_GARAGE came and was not said back: it goes before the next word.
        self._garage_owed = False

    @property
    def verdict(self) -> Verdict:
        """Return what holds as of the last input."""
        return self._arbiter.verdict

    @property
    def is_open(self) -> bool:
        """Whether there is a connection; if not, a socket that is left must be closed."""
        return self._decoder is not None

    def tick(self, now: float) -> None:
        """Let time pass. Call it in every turn of the loop that brakes."""
        self._follow(self._arbiter.tick(now))

    def connected(self, now: float) -> None:
        """Begin a new connection to race control, whatever became of the last."""
        self._arbiter.connected(now)
        self._decoder, self._garage_owed = FrameDecoder(), False

    def closed(self, now: float, reason: str = 'the connection is closed') -> None:
        """End the connection: it is closed or broken, or you close it; `reason` is for people."""
        self._arbiter.disconnected(reason, now)
        self._decoder = None

    def received(self, data: bytes, now: float) -> None:
        """
        Take what has come on the present connection: any number of bytes, cut anywhere.

        Read all there is before you look at the verdict, so that the kart obeys the last frame.
        """
        self.tick(now)  # what comes after too long a silence comes too late
        for event in self._decoder.feed(data) if self._decoder else []:
            if isinstance(event, StateFrame):
                self._heard_since_said = True
                if event.state is RaceState.IN_GARAGE is not self.verdict.commanded:
                    self._garage_owed = True
                self._follow(self._arbiter.heard(event.state, now))
            else:
                self.malformed += 1

    def team_stop(
        self, engaged: bool, now: float, source: StopSource = StopSource.SERVICE
    ) -> None:
        """
        Engage or release the team's stop (§2.C). Each source must release its own.

        With `Settings.tsr_timeout`, every message of the safety remote must come here with
        ``StopSource.TSR``, those that say go too.
        """
        self._follow(self._arbiter.team_stop(source, engaged, now))

    def speed(self, metres_per_s: float, now: float) -> bytes:
        """
        Take the kart's measured speed, in m/s. From then on no red is acknowledged without it.

        :return: what to send: the stop is acknowledged by itself if the settings say so.
        """
        return self._follow(self._arbiter.speed(metres_per_s, now))

    def acknowledge(self, order: int, now: float) -> bytes:
        """
        Say that the kart has reached the state of a verdict.

        Call it in every turn in which that is true, with the order of the verdict that the kart
        acted on, not a newer one. A kart that stopped itself in GRID_ACTIVE or GREEN_GREEN, and
        stands, so says RED_RED, once.

        :return: what to send: all of it, with nothing in between. Empty: the order is over, or
            the arbiter refuses, or it was sent already and no frame has come since.
        """
        self.tick(now)
        reached = self.verdict.reached
        if reached is None:
            return b''
        return self._follow(self._arbiter.acknowledge(reached, order, now))

    def _follow(self, outcome: Outcome) -> bytes:
        """Take note of what follows from an input; return what to send."""
        if outcome.give_up is not None:
            self._decoder = None
        order = outcome.verdict.order
        if outcome.send is None or (order == self._said_order and not self._heard_since_said):
            return b''
        self._said_order, self._heard_since_said = order, False
        overtaken = self._garage_owed and outcome.send is not RaceState.IN_GARAGE
        self._garage_owed = False
        return (encode(RaceState.IN_GARAGE) if overtaken else b'') + encode(outcome.send)
