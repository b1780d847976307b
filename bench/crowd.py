"""Many plain karts in one process, which notes when each first sees a state."""

from __future__ import annotations

import json
import resource
import selectors
import socket
import sys
import time

from evgp_protocol.frames import encode
from evgp_protocol.states import RaceState


def address_of(number: int) -> str:
    """Return the loopback address of the kart with this number, 1 to 60000."""
    return f'127.{10 + number // 62500}.{number // 250 % 250}.{1 + number % 250}'


def main() -> None:
    """
    Connect karts 1 to N to a port and obey the commands on stdin, one line of JSON each.

    ``watch STATE`` answers with the monotonic time (s) at which the last kart saw the state for
    the first time, once all have; ``gaps SECONDS`` with the frames of each kart in that time and
    its longest gap (s).

    What a kart acknowledges while a state is watched for it says when all have seen the state:
    each would have a processor of its own, and none takes time from another that reads.
    """
    port, count, acknowledges = int(sys.argv[1]), int(sys.argv[2]), sys.argv[3] == 'acknowledge'
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(hard, max(soft, count + 100)), hard))
    selector = selectors.DefaultSelector()
    karts = []
    for number in range(1, count + 1):
        kart = socket.create_connection(
            ('127.0.0.1', port), 10.0, source_address=(address_of(number), 0)
        )
        kart.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        kart.setblocking(False)
        selector.register(kart, selectors.EVENT_READ, len(karts))
        karts.append(kart)
    selector.register(sys.stdin, selectors.EVENT_READ, -1)
    last_state = [b''] * count
    seen_at = [0.0] * count
    waiting: set[int] = set()
    unsaid: list[int] = []
    wanted = b''
    gaps_until = 0.0
    heard_at = [0.0] * count
    frames = [0] * count
    worst = [0.0] * count

    def answer(value: object) -> None:
        print(json.dumps(value), flush=True)

    answer('ready')
    while True:
        timeout = max(gaps_until - time.monotonic(), 0.0) if gaps_until else None
        ready = selector.select(timeout)
        now = time.monotonic()
        for key, _ in ready:
            index = key.data
            if index < 0:
                words = sys.stdin.readline().split()
                if not words:
                    return
                if words[0] == 'watch':
                    wanted = encode(RaceState[words[1]])
                    waiting = {n for n in range(count) if last_state[n] != wanted}
                    if not waiting:
                        answer(now)
                else:
                    gaps_until = now + float(words[1])
                    heard_at = [now] * count
                    frames = [0] * count
                    worst = [0.0] * count
                continue
            try:
                data = karts[index].recv(65536)
            except BlockingIOError:
                continue
            if not data:
                selector.unregister(karts[index])
                continue
            # Race control writes whole frames, and these sockets take them whole.
            begin = data.rindex(b'$')
            state = data[begin:]
            if gaps_until:
                frames[index] += data.count(b';')
                worst[index] = max(worst[index], now - heard_at[index])
                heard_at[index] = now
            if state != last_state[index]:
                last_state[index] = state
                if acknowledges:
                    unsaid.append(index)
                if state == wanted and index in waiting:
                    seen_at[index] = time.monotonic()
                    waiting.discard(index)
                    if not waiting:
                        answer(max(seen_at))
        if unsaid and not waiting:
            for index in unsaid:
                karts[index].send(last_state[index])
            unsaid.clear()
        if gaps_until and now >= gaps_until:
            gaps_until = 0.0
            answer({'frames': frames, 'worst': worst})


if __name__ == '__main__':
    main()
