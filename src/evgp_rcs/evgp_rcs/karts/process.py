# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The kart server's process, which holds the rules and the karts' sockets, and does not use ROS.

The ROS half (``node``) starts this process, and a local socket pair connects the two
(``channel``). This process in turn starts the record's process. Neither half outlives the other.
If the ROS half ends, or is silent for `ROS_HALF_SILENCE`, officials could no longer stop a kart,
so this process sends every kart RED_RED and ends.

One thread runs the kart server's loop. If the ROS half is slow, events for it wait here, and the
kart server skips snapshots of the race.
"""

from __future__ import annotations

import asyncio
import contextlib
import gc
import os
import signal
import socket
import sys

from evgp_protocol.loop import run
from evgp_rcs.karts import priority
from evgp_rcs.karts.channel import (
    Begin,
    Failed,
    KartServerError,
    Listening,
    LocalEnd,
    pack,
)
from evgp_rcs.karts.record_process import RecordProcess, wake_when_the_parent_dies
from evgp_rcs.karts.server import KartServer, RosHalfGoneError
from evgp_rcs.record import run_mark
from evgp_rcs.record.store import RecordError, rules_version
from evgp_rcs.rules.inputs import Batch, Recovered, Rules, Setup
from evgp_rcs.rules.race import LastRun

LAST_WORDS_TIMEOUT = 2.0
"""Maximum time for the record to finish at the end, in seconds. After that, the ROS half has the
same time to accept the last messages."""


async def serve(begin: Begin, ros_half: LocalEnd, record: RecordProcess) -> LastRun:
    """
    Run the kart server until it ends, and return how this run ended, for the next run.

    :raises KartServerError: if the kart server cannot start.
    :raises BaseException: the failure that ended the kart server.
    """
    loop = asyncio.get_running_loop()
    setup = Setup(begin.roster.karts, begin.times, begin.roster.heats, loop.time())
    record.attach(loop)
    record.put(Batch(0, [Rules(rules_version(), setup)]))
    race = setup.race(begin.run)
    server = KartServer(race, begin.settings, ros_half, record)
    left_behind = Recovered(
        loop.time(),
        record.opened.left_behind,
        LastRun.UNKNOWN if begin.cannot_know else record.opened.last_run,
        begin.cannot_know or record.opened.why,
    )
    priority.come_first()
    ros_half.attach(loop, server.take_commands)
    # A signal to this process makes it end normally. Signals from a terminal reach only the ROS
    # half.
    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP, signal.SIGQUIT):
        loop.add_signal_handler(number, server.end)
    signal.signal(signal.SIGTSTP, signal.SIG_IGN)
    # The race and its karts stay until the end, so the garbage collector need not visit them.
    gc.collect()
    gc.freeze()

    def listening(address: tuple[str, int]) -> None:
        record.remember(race.memory())
        ros_half.send(pack(Listening(address)))

    return await server.serve(left_behind, listening)


def main(arguments: list[str] | None = None) -> int:
    """
    Run the kart server for the ROS half at the other end of an inherited socket.

    :param arguments: the number of that socket's file descriptor.
    :return: 0 after an orderly end, 1 after a failure, 2 if the kart server could not start.
    """
    (descriptor,) = sys.argv[1:] if arguments is None else arguments
    wake_when_the_parent_dies()
    priority.come_before_others()  # this process has a session of its own
    with socket.socket(fileno=int(descriptor)) as end:
        ros_half = LocalEnd(end)
        try:
            begin = ros_half.first()
        except EOFError:
            return 1
        gc.freeze()  # so that memory shared with the record's process stays shared
        try:
            mark = run_mark.place(begin.settings.host, begin.settings.port)
            record = RecordProcess(begin.record, mark, begin.run)
        except RecordError as error:
            ros_half.send_the_rest(Failed(str(error)), timeout=LAST_WORDS_TIMEOUT)
            return 2
        try:
            ends_as = run(serve(begin, ros_half, record))
        except KartServerError as error:
            # This run has sent nothing to any kart, so it leaves behind what the last run left.
            record.end(LAST_WORDS_TIMEOUT, record.opened.last_run)
            ros_half.send_the_rest(Failed(str(error)), timeout=LAST_WORDS_TIMEOUT)
            return 2
        except BaseException as error:
            record.end(LAST_WORDS_TIMEOUT, LastRun.UNKNOWN)
            words = str(error) or type(error).__name__
            ros_half.send_the_rest(Failed(words), timeout=LAST_WORDS_TIMEOUT)
            if not isinstance(error, RosHalfGoneError):
                raise
            # SIGCONT wakes a stopped ROS half, which then ends. If the ROS half has died, this
            # process has another parent.
            with contextlib.suppress(PermissionError):
                os.kill(os.getppid(), signal.SIGCONT)
            return 1
        record.end(LAST_WORDS_TIMEOUT, ends_as)
        ros_half.send_the_rest(timeout=LAST_WORDS_TIMEOUT)
        return 0


if __name__ == '__main__':
    sys.exit(main())
