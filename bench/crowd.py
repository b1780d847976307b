# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Many plain karts in one process, which notes when each first sees a state."""

from __future__ import annotations

import json
import resource
import selectors
import sys

from evgp_protocol.states import RaceState
from evgp_testing.race_control import address_of
from evgp_testing.wire_kart import KartLink


def main() -> None:
    """
    Connect karts 1 to N to a port and obey the commands on stdin, one line of JSON each.

    ``watch STATE`` answers, once all karts have seen the state, with the monotonic time (s) at
    which the last of them had read the first frame of it.

    The third argument says what karts say: ``mute`` nothing, ``acknowledge`` each change.

    What a kart acknowledges while a state is watched for it says when all have seen the state:
    each would have a processor of its own, and none takes time from another that reads.
    """
    port, count, manner = int(sys.argv[1]), int(sys.argv[2]), sys.argv[3]
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(hard, max(soft, count + 100)), hard))
    selector = selectors.DefaultSelector()
    karts = [KartLink(address_of(number), ('127.0.0.1', port)) for number in range(1, count + 1)]
    for kart in karts:
        kart.socket.setblocking(False)
        selector.register(kart.socket, selectors.EVENT_READ, kart)
    selector.register(sys.stdin, selectors.EVENT_READ)
    waiting: set[KartLink] = set()
    unsaid: list[KartLink] = []
    wanted: RaceState | None = None

    def answer(value: object) -> None:
        print(json.dumps(value), flush=True)

    def answer_seen() -> None:
        answer(max(each.changes[-1][0] for each in karts))

    answer('ready')
    while True:
        ready = selector.select()
        for key, _ in ready:
            kart = key.data
            if kart is None:
                words = sys.stdin.readline().split()
                if not words:
                    return
                wanted = RaceState[words[1]]
                waiting = {each for each in karts if each.state is not wanted}
                if not waiting:
                    answer_seen()
                continue
            heard = kart.take()
            if heard is None:
                selector.unregister(kart.socket)
                continue
            for state, change in heard:
                if change and manner == 'acknowledge':
                    unsaid.append(kart)
                if state is wanted and kart in waiting:
                    waiting.discard(kart)
                    if not waiting:
                        answer_seen()
        if unsaid and not waiting:
            for each in unsaid:
                assert each.state is not None
                each.say(each.state)
            unsaid.clear()


if __name__ == '__main__':
    main()
