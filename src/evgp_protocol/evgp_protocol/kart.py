# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
A kart without ROS: from bytes and times, it determines what to obey and what to send.

This module has no socket, clock, thread or log, and no rules of its own: it combines the arbiter
with the frame decoder. In each turn of a kart's loop, at least 20 times a second::

    kart.tick(now)                          # first: is race control silent?
    kart.received(data, now)                # everything that has arrived
    verdict = kart.verdict
    if not kart.is_open:
        ...                                 # close the socket, if any, and reconnect later
    if drive(verdict.state, verdict.may_drive):
        send(kart.acknowledge(verdict.order, now))

Call `Kart.connected` when a connection is made, and `Kart.closed` when it ends. ``drive`` must not
wait, and returns whether the kart *has* reached the state. ``kit/python/example.py`` is a whole
program, and ``kit/c/evgp_kart.h`` does the same in C.
"""

from __future__ import annotations

from evgp_protocol.arbiter import Arbiter, Reaction, Settings, StopSource, Verdict
from evgp_protocol.frames import encode, FrameDecoder, StateFrame
from evgp_protocol.states import RaceState


class Kart:
    """
    One kart and its connection to race control. It has one owner.

    Every input carries its time, in seconds, from a clock that cannot be set and that keeps
    running during suspend: `evgp_protocol.clock.now`. If a time is before an earlier one, the
    connection counts as lost. It is also lost after `Settings.frame_timeout` without a `tick`.

    :param arbiter: an arbiter that has more inputs than these; its owner passes their reactions to
        `follow`. None for one with these settings.
    :ivar malformed: number of malformed frames so far.
    :ivar last_malformed: what was wrong with the last malformed frame, if there was one.
    """

    def __init__(self, settings: Settings | None = None, arbiter: Arbiter | None = None) -> None:
        self.malformed, self.last_malformed = 0, ''
        self._arbiter = arbiter or Arbiter(settings or Settings(), first_order=1)
        self._decoder: FrameDecoder | None = None  # of the current connection, if any
        # The last two ticks. What is read now arrived after the first of them: otherwise, it would
        # have been read before the second.
        self._turn = self._turn_before = 0.0
        self._said_order = 0
        self._heard_since_said = False
        # IN_GARAGE is not acknowledged yet, which must happen before any other acknowledgement.
        self._garage_owed = False

    @property
    def verdict(self) -> Verdict:
        """Return what the kart must do as of the last input."""
        return self._arbiter.verdict

    @property
    def is_open(self) -> bool:
        """Return whether there is a connection. If there is none, close any open socket."""
        return self._decoder is not None

    def tick(self, now: float) -> None:
        """Let time pass. Call it once in every turn of the loop that brakes."""
        self._turn_before, self._turn = self._turn, now
        self.follow(self._arbiter.tick(now))

    def connected(self, now: float) -> None:
        """Begin a new connection to race control; the previous one counts as lost."""
        self._arbiter.connected(now)
        self._turn = self._turn_before = now
        self._decoder, self._garage_owed = FrameDecoder(), False

    def closed(self, now: float, reason: str = 'the connection is closed') -> None:
        """End the connection, whoever closed or broke it. People read the `reason`."""
        self._arbiter.disconnected(reason, now)
        self._decoder = None

    def received(self, data: bytes, now: float) -> None:
        """
        Handle what arrived on the current connection: any number of bytes, split anywhere.

        Read everything before you look at the verdict, so that the kart obeys the last frame. A
        frame may have waited while the kart was held up, so silence counts from the tick before
        the last one.
        """
        self.follow(self._arbiter.tick(now))  # frames that arrive after the timeout are too late
        for event in self._decoder.feed(data) if self._decoder else []:
            if isinstance(event, StateFrame):
                self._heard_since_said = True
                if event.state is RaceState.IN_GARAGE is not self.verdict.commanded:
                    self._garage_owed = True
                self.follow(self._arbiter.heard(event.state, now, self._turn_before))
            else:
                self.malformed += 1
                self.last_malformed = f'{event.reason}: {event.raw!r}'

    def team_stop(
        self, engaged: bool, now: float, source: StopSource = StopSource.SERVICE
    ) -> None:
        """
        Engage or release the team's stop (§2.C). Each source must release its own.

        With `Settings.tsr_timeout`, pass every message of the safety remote with
        ``StopSource.TSR``, including those that say go.
        """
        self.follow(self._arbiter.team_stop(source, engaged, now))

    def acknowledge(self, order: int, now: float) -> bytes:
        """
        Report that the kart has reached the state of a verdict.

        Call this in every turn in which that is true, with the order of the verdict that the kart
        acted on, not of a newer one. For a kart that stopped itself in GRID_ACTIVE or GREEN_GREEN
        and stands still, this reports RED_RED, once.

        :return: bytes to send, all of them and with nothing in between. There are none if the
            order is over, if the arbiter refuses, or if they would repeat the last acknowledgement
            although no frame has arrived since.
        """
        self.follow(self._arbiter.tick(now))
        reached = self.verdict.reached
        if reached is None:
            return b''
        return self.follow(self._arbiter.acknowledge(reached, order, now))

    def acknowledge_garage(self, now: float) -> bytes:
        """
        Acknowledge IN_GARAGE, for a kart that need not do anything first. Call it in every turn.

        The frame shows race control that later ones do not answer earlier commands, even if
        another command has already followed.

        :return: bytes to send, if any.
        """
        verdict = self.verdict
        if verdict.commanded is RaceState.IN_GARAGE and not verdict.acknowledged:
            return self.acknowledge(verdict.order, now)
        overtaken, self._garage_owed = self._garage_owed, False
        return encode(RaceState.IN_GARAGE) if overtaken and self.is_open else b''

    def follow(self, reaction: Reaction) -> bytes:
        """Carry out the reaction to an input of the arbiter; return bytes to send, if any."""
        if reaction.give_up is not None:
            self._decoder = None
        order = reaction.verdict.order
        if reaction.send is None or (order == self._said_order and not self._heard_since_said):
            return b''
        self._said_order, self._heard_since_said = order, False
        overtaken = self._garage_owed and reaction.send is not RaceState.IN_GARAGE
        self._garage_owed = False
        return (encode(RaceState.IN_GARAGE) if overtaken else b'') + encode(reaction.send)
