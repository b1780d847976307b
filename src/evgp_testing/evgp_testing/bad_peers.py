"""Bad peers of race control, each in a process of its own, and the race that must not notice."""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
import pathlib
import select
import subprocess
import sys

from evgp_protocol.states import RaceState
from evgp_testing.domains import Domain
from evgp_testing.official import Official
from evgp_testing.process import PATIENCE
from evgp_testing.punctual_kart import PunctualKart
from evgp_testing.race_control import address_of, RaceControl
from evgp_testing.wire_kart import Acknowledges

RACING = (1, 2)
BAD = 3
KART = address_of(BAD)
STRANGER = '127.0.9.9'

ATTACKS = {
    'slow_reader': KART,
    'flood': KART,
    'random_bytes': KART,
    'endless_frame': KART,
    'nuls': KART,
    'nested': KART,
    'half_close': KART,
    'reset': KART,
    'reconnects': KART,
    'hammer': STRANGER,
    'many_connections': STRANGER,
}
"""Every attack of ``bad_peer``, and from where: a kart of the roster, or a stranger."""

_SCRIPT = pathlib.Path(__file__).with_name('bad_peer.py')


class AttackedRace:
    """
    Race control with two good karts in the race, and one in the roster that is not good.

    :param folder: where race control's files are written.
    """

    def __init__(self, folder: pathlib.Path) -> None:
        """Start everything, and wait until the good karts are connected."""
        self._stack = contextlib.ExitStack()
        try:
            domain = self._stack.enter_context(Domain()).number
            self.control = self._stack.enter_context(RaceControl(folder, domain, RACING, [BAD]))
            self.official = Official(domain)
            self._stack.callback(self.official.close)
            self.karts = [
                self._stack.enter_context(
                    PunctualKart(address_of(number), self.control.port, Acknowledges.EACH_CHANGE)
                )
                for number in RACING
            ]
            self.official.wait_for_connected(*RACING)
        except BaseException:
            self.close()
            raise

    def green(self) -> None:
        """Start the race from the garage."""
        self.official.command('grid_active', track_clear=True)
        self.official.wait_for_acks(RaceState.GRID_ACTIVE, *RACING)
        self.official.command('green_green')
        self.official.wait_for_acks(RaceState.GREEN_GREEN, *RACING)

    def home(self) -> None:
        """Bring the race to the garage from a stop."""
        self.official.wait_for_acks(RaceState.RED_RED, *RACING)
        self.official.command('in_garage', track_safe=True)
        for kart in self.karts:
            kart.wait_for_state(RaceState.IN_GARAGE)

    def close(self) -> None:
        """End everything."""
        self._stack.close()

    def __enter__(self) -> AttackedRace:
        """Return this race."""
        return self

    def __exit__(self, *exc: object) -> None:
        """End it."""
        self.close()


@contextlib.contextmanager
def attacking(name: str, port: int, host: str = '127.0.0.1') -> Iterator[None]:
    """
    Have a bad peer attack race control meanwhile.

    :raises AssertionError: if it does not get under way.
    """
    with subprocess.Popen(
        [sys.executable, '-I', str(_SCRIPT), name, host, str(port), ATTACKS[name]],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    ) as peer:
        assert peer.stdin is not None
        assert peer.stdout is not None
        try:
            under_way, _, _ = select.select([peer.stdout], [], [], PATIENCE)
            assert under_way, f'{name} did not get under way'
            assert peer.stdout.readline() == b'ready\n'
            yield
        finally:
            peer.stdin.close()
            try:
                peer.wait(10)
            except subprocess.TimeoutExpired:
                peer.kill()
