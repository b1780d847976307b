# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Machines with a network of their own, on one machine: namespaces, cables, and the air between.

A ``Track`` has one network namespace in the middle. Each ``Machine`` has another, with one
interface, whose cable (a veth pair) ends in the middle; there the relay (``relay``) carries
frames from cable to cable, and loses or delays them as it is told. What runs in
``with machine.inside():`` makes its sockets, threads and processes in that machine's network.

The namespaces have no names: they are open files of this process. So no two runs can meet, and
whatever happens to this process, the kernel takes all of them away, cables and addresses too.
"""

from __future__ import annotations

from collections.abc import Iterator
import concurrent.futures
import contextlib
import ctypes
import fcntl
import functools
import json
import os
import pathlib
import socket
import struct
import subprocess
import sys

from evgp_testing.part import Part, PATIENCE
from rig.needs import cannot_run

_CLONE_NEWNET = 0x40000000
_SIOCETHTOOL = 0x8946
# ETHTOOL_STXCSUM, _SSG, _STSO, _SGSO, _SGRO: what leaves is whole, of frame size, with its sum.
_OFFLOADS = (0x17, 0x19, 0x1F, 0x24, 0x2C)
_LIBC = ctypes.CDLL(None, use_errno=True)

RACE_CONTROL = '10.77.0.1'
"""Race control's address on a track."""


def own_disk(folder: pathlib.Path) -> tuple[str, ...]:
    """
    Return words that run a command as on a machine of its own, which keeps its mark in a folder.

    Only what race control keeps of itself beside its record is its own
    (``evgp_rcs.record.run_mark``).
    """
    folder.mkdir(exist_ok=True)
    script = 'mount --bind "$0" /var/tmp && exec "$@"'
    return ('unshare', '--mount', 'sh', '-c', script, str(folder))


def kart_address(number: int) -> str:
    """Return the address of a kart on a track."""
    return f'10.77.0.{100 + number}'


class NetworkError(RuntimeError):
    """This machine does not let us make networks; the text says what is missing."""


def _system_call(name: str, *arguments: int) -> None:
    if getattr(_LIBC, name)(*arguments):
        number = ctypes.get_errno()
        raise NetworkError(f'{name} of a network namespace: {os.strerror(number)} (not root?)')


class Namespace(Part):
    """A network namespace without a name; it lives until it is closed and nothing runs in it."""

    def __init__(self) -> None:
        """
        Make it, with the loopback interface up.

        :raises NetworkError: if that is not allowed.
        """

        def make() -> int:
            _system_call('unshare', _CLONE_NEWNET)
            return os.open('/proc/thread-self/ns/net', os.O_RDONLY)

        # In a thread of its own, which ends: unshare moves the one that calls it.
        with concurrent.futures.ThreadPoolExecutor(1) as thread:
            self._file = thread.submit(make).result()
        self.path = f'/proc/{os.getpid()}/fd/{self._file}'
        try:
            self.ip('link set lo up')
        except BaseException:
            self.close()
            raise

    @contextlib.contextmanager
    def inside(self) -> Iterator[None]:
        """Have this thread, and the threads and processes it starts, in this namespace."""
        own = os.open('/proc/thread-self/ns/net', os.O_RDONLY)
        try:
            _system_call('setns', self._file, _CLONE_NEWNET)
            try:
                yield
            finally:
                _system_call('setns', own, _CLONE_NEWNET)
        finally:
            os.close(own)

    def ip(self, *commands: str) -> None:
        """
        Run commands of ``ip`` in here.

        :raises NetworkError: if one fails.
        """
        with self.inside():
            try:
                subprocess.run(
                    ['ip', '-batch', '-'],
                    input='\n'.join(commands),
                    text=True,
                    check=True,
                    capture_output=True,
                    timeout=PATIENCE,
                )
            except FileNotFoundError as error:
                raise NetworkError('there is no command ip: install iproute2') from error
            except subprocess.CalledProcessError as error:
                raise NetworkError(f'ip {"; ".join(commands)}: {error.stderr.strip()}') from error

    def cable(self, card: str, address: str, to: Namespace, its_address: str) -> None:
        """Lay a cable from an interface of this machine to eth0 of another."""
        self.ip(f'link add {card} type veth peer name eth0 netns {to.path}')
        for machine, own, at in ((self, card, address), (to, 'eth0', its_address)):
            machine.ip(f'addr add {at}/24 dev {own}', f'link set {own} up')

    def close(self) -> None:
        os.close(self._file)


class Machine(Namespace):
    """
    A machine with one interface, eth0, whose cable ends at the track.

    :param name: the name of its cable, at most 15 characters.
    """

    def __init__(self, track: Track, name: str, address: str) -> None:
        """Make the machine and plug it in."""
        super().__init__()
        self.name = name
        self.address = address
        self._track = track
        try:
            track.middle.ip(
                f'link add {name} type veth peer name eth0 netns {self.path}',
                f'link set {name} up',
            )
            with self.inside():
                _switch_offloads_off('eth0')
            self.ip(
                f'addr add {address}/24 dev eth0',
                'link set eth0 up',
                'route add 239.0.0.0/8 dev eth0',  # by which ROS finds other machines
            )
            track.order('plug', name=name)
        except BaseException:
            self.close()
            raise

    def air(
        self,
        loss: float = 0.0,
        delay: float = 0.0,
        *,
        toward: float | None = None,
        back: float | None = None,
        rate: float = 0.0,
    ) -> float:
        """
        Set what happens to its frames from now on, and return the time (monotonic, s).

        :param loss: the share that is lost, evenly spaced, in each direction.
        :param delay: how late they come, in each direction, s.
        :param toward: the share that is lost toward this machine, if not the same.
        :param back: the share that is lost on the way from it, if not the same.
        :param rate: how fast they go in each direction, bit/s; 0: at once.
        """
        return self._track.order(
            'air',
            name=self.name,
            toward=[loss if toward is None else toward, delay, rate],
            back=[loss if back is None else back, delay, rate],
        )


class Track(Part):
    """
    The network between race control and the karts.

    :raises NetworkError: if this machine does not let us make networks.
    """

    def __init__(self) -> None:
        """Make the namespace in the middle and start the relay there."""
        self.middle = Namespace()
        script = pathlib.Path(__file__).with_name('relay.py')
        with self.middle.inside():
            self._relay = subprocess.Popen(
                [sys.executable, '-I', str(script)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
            )
        self._machines = contextlib.ExitStack()

    def machine(self, name: str, address: str) -> Machine:
        """Return a new machine, plugged in; it goes with the track."""
        return self._machines.enter_context(Machine(self, name, address))

    def order(self, what: str, **details: object) -> float:
        """Have the relay do something; return when it was done (monotonic, s)."""
        assert self._relay.stdin is not None
        assert self._relay.stdout is not None
        self._relay.stdin.write(json.dumps({'do': what, **details}) + '\n')
        self._relay.stdin.flush()
        line = self._relay.stdout.readline()
        assert line, f'the relay did not answer to {what}'
        return float(line)

    def close(self) -> None:
        """End the relay and take every machine away."""
        with self._machines, self._relay:  # which ends with its input
            self.middle.close()


@functools.cache
def why_not() -> str:
    """Return why no networks can be made on this machine; empty: they can."""
    try:
        with Track() as track:
            track.machine('probe', kart_address(1))
    except NetworkError as error:
        return str(error)
    return ''


def _switch_offloads_off(interface: str) -> None:
    """Have the kernel send frames as they would go over a real cable."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
        for command in _OFFLOADS:
            value = ctypes.create_string_buffer(struct.pack('II', command, 0))
            request = struct.pack('16sP', interface.encode(), ctypes.addressof(value))
            fcntl.ioctl(any_socket, _SIOCETHTOOL, request.ljust(40, b'\0'))


def need_networks() -> None:
    """Skip the test where no networks can be made, and say why; not where all tests must run."""
    if why := why_not():
        cannot_run(why)
