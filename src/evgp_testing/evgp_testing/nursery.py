# Copyright 2026 EVGP race control contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""
Fast starts: a program runs in a process that has already imported rclpy or Qt.

Most of the time that a program of ours takes to start goes into imports, and a test run starts
hundreds of programs. So the pytest plugin keeps a few nurseries. A nursery is a process that has
imported what the programs import and has used nothing of it. To start a program, the nursery
forks; the child runs the program's file from its first line, with its own arguments, environment,
network namespace, output and exit code. Some settings, such as LD_PRELOAD, are read before Python
runs. A program with such a setting is started in the usual way (`Nursery.fits`).

Race control starts its kart server as a process of its own, and most of that start is imports,
too. So a race control that grew here has a *seed* (`_Seed`): a child that was forked before the
program's first line, and becomes the kart server once race control starts it.

Only tests do this. The demonstration, the soak and the benchmarks start programs in the usual way.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
import contextlib
import ctypes
import functools
import gc
import importlib
import inspect
import io
import json
import os
import pathlib
import re
import runpy
import select
import signal
import socket
import subprocess
import sys
import threading
import time
import types
from typing import Any, IO

RACE_CONTROL = 'rcs_node'
"""The program that starts a kart server."""

NODES = (
    *('evgp_rcs.node', 'evgp_kart_bridge.node', 'evgp_kart_bridge.example_stack'),
    'evgp_rcs.kart_process',
    *('evgp_rcs_console.ctl', 'evgp_rcs_console.desk', 'evgp_rcs_msgs.msg', 'evgp_rcs_msgs.srv'),
)
"""What the programs without a window import."""

WINDOWS = ('evgp_rcs_console.gui', 'evgp_rcs_console.window', 'evgp_testing.console')
"""What the officials' window imports."""

TESTS = (*NODES, 'pytest', '_pytest.config', 'yaml')
"""What a test imports."""

_READ_BY_EXEC = ('LD_', 'PYTHON', 'RMW_', 'QT_API', 'MALLOC_', 'GLIBC_')
"""Prefixes of the environment variables that a process reads before its program runs."""

_OF_THE_PROGRAM = ('PYTHONUNBUFFERED',)

_PR_SET_PDEATHSIG = 1  # of linux/prctl.h
_CLONE_NEWNET = 0x40000000
_NETWORK = '/proc/thread-self/ns/net'
_LIBC = ctypes.CDLL(None, use_errno=True)
_MOST_BYTES = 2**20


def _read_by_exec(environment: Mapping[str, str]) -> dict[str, str]:
    return {
        name: value
        for name, value in environment.items()
        if name.startswith(_READ_BY_EXEC) and name not in _OF_THE_PROGRAM
    }


class Grown:
    """
    A process that a nursery has started, to be used as ``subprocess.Popen`` is.

    ``stdout`` and ``stderr`` are what it prints, as text, where that was asked for.
    """

    def __init__(
        self, args: Sequence[str], pid: int, end: socket.socket, outputs: Sequence[IO[str] | None]
    ) -> None:
        """Take over what the nursery has started."""
        self.args = list(args)
        self.pid = pid
        self.returncode: int | None = None
        self.stdout, self.stderr = outputs
        self._end = end
        self._asking = threading.Lock()

    def poll(self) -> int | None:
        """Return its exit code if it has ended (negative: the signal's number)."""
        return self._ask(0.0)

    def wait(self, timeout: float | None = None) -> int:
        """
        Return its exit code once it has ended.

        :param timeout: maximum time until then, in seconds.
        :raises subprocess.TimeoutExpired: if it has not ended by then.
        """
        code = self._ask(timeout)
        if code is None:
            raise subprocess.TimeoutExpired(self.args, timeout or 0.0)
        return code

    def communicate(self, timeout: float | None = None) -> tuple[str, str]:
        """
        Return all that it prints, once it has ended.

        :raises subprocess.TimeoutExpired: if it has not ended by then.
        """
        texts = ['', '']

        def read(at: int, stream: IO[str]) -> None:
            texts[at] = stream.read()

        reading = [
            threading.Thread(target=read, args=(at, stream), daemon=True)
            for at, stream in enumerate((self.stdout, self.stderr))
            if stream is not None
        ]
        for thread in reading:
            thread.start()
        until = None if timeout is None else time.monotonic() + timeout
        for thread in reading:
            thread.join(None if until is None else max(0.0, until - time.monotonic()))
            if thread.is_alive():
                raise subprocess.TimeoutExpired(self.args, timeout or 0.0)
        self.wait(None if until is None else max(0.0, until - time.monotonic()))
        return texts[0], texts[1]

    def send_signal(self, number: int) -> None:
        """Send it a signal, unless it has ended."""
        if self.poll() is None:
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.pid, number)

    def terminate(self) -> None:
        """Ask it to end."""
        self.send_signal(signal.SIGTERM)

    def kill(self) -> None:
        """End it as a crash does."""
        self.send_signal(signal.SIGKILL)

    def __enter__(self) -> Grown:
        """Return this process."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: types.TracebackType | None,
    ) -> None:
        """Wait until it ends."""
        for stream in (self.stdout, self.stderr):
            if stream is not None:
                stream.close()
        self.wait()

    def _ask(self, timeout: float | None) -> int | None:
        # Several threads may ask: all wake when it ends, and the first one to come is told.
        with contextlib.suppress(ValueError):  # closed since: another one was told
            if self.returncode is None and select.select([self._end], [], [], timeout)[0]:
                with self._asking:
                    if self.returncode is None:
                        self.returncode = int(self._end.recv(64) or -signal.SIGKILL)
                        self._end.close()
        return self.returncode


class Nursery:
    """
    A process that the others are forked from; it ends with this one.

    :param modules: what it imports before.
    """

    def __init__(self, modules: Sequence[str]) -> None:
        """Start it; it imports in the background."""
        self._own, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._turn = threading.Lock()
        self._environment = _read_by_exec(os.environ)
        with other:
            self._process = subprocess.Popen(
                [sys.executable, '-P', __file__, str(other.fileno()), *modules],
                pass_fds=(other.fileno(),),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
            )

    def fits(self, program: str, environment: Mapping[str, str]) -> bool:
        """Return whether a forked process would be as one that was started."""
        return (
            _read_by_exec(environment) == self._environment
            and self._process.poll() is None
            and _is_python(program)
        )

    def start(
        self,
        args: Sequence[str],
        environment: Mapping[str, str],
        stdout: int,
        stderr: int,
        cwd: pathlib.Path,
    ) -> Grown:
        """Start a Python program, as the function `start` does."""
        with contextlib.ExitStack() as closing:
            network = os.open(_NETWORK, os.O_RDONLY)
            closing.callback(os.close, network)
            ends: list[int] = [os.open(os.devnull, os.O_RDONLY)]
            closing.callback(os.close, ends[0])
            outputs: list[IO[str] | None] = []
            for wanted in (stdout, stderr):
                output = None
                if wanted == subprocess.PIPE:
                    reading, writing = os.pipe()
                    closing.callback(os.close, writing)
                    output = open(reading, errors='replace')  # noqa: PTH123, SIM115 - a pipe
                    ends.append(writing)
                else:
                    ends.append(ends[1] if wanted == subprocess.STDOUT else wanted)
                outputs.append(output)
            told, tells = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            closing.callback(tells.close)
            request = {'args': list(args), 'environment': dict(environment), 'cwd': str(cwd)}
            with self._turn:
                socket.send_fds(
                    self._own, [json.dumps(request).encode()], [*ends, network, tells.fileno()]
                )
                pid = int(self._own.recv(64))
        return Grown(args, pid, told, outputs)

    def close(self) -> None:
        """End it."""
        self._own.close()
        self._process.wait()


_kept: dict[tuple[str, ...], Nursery] | None = None


def keep() -> None:
    """Have `start` grow processes from now on, each kind from a nursery that is kept."""
    global _kept
    _kept = {}


def let_go() -> None:
    """End what is kept."""
    global _kept
    kept, _kept = _kept or {}, None
    for nursery in kept.values():
        nursery.close()


@contextlib.contextmanager
def unused() -> Iterator[None]:
    """Have programs start in the usual way, meanwhile."""
    global _kept
    kept, _kept = _kept, None
    try:
        yield
    finally:
        _kept = kept


def start(
    args: Sequence[str],
    environment: Mapping[str, str],
    *,
    modules: tuple[str, ...] = NODES,
    stdout: int = subprocess.PIPE,
    stderr: int = subprocess.STDOUT,
    cwd: pathlib.Path | None = None,
) -> Grown | None:
    """
    Start a Python program, by its path, from a nursery; None where it must be started as ever.

    :param modules: what its nursery has imported.
    :param stdout: ``subprocess.PIPE``, or a file descriptor.
    :param stderr: ``subprocess.PIPE``, ``subprocess.STDOUT`` or a file descriptor.
    """
    if _kept is None:
        return None
    if modules not in _kept:
        _kept[modules] = Nursery(modules)
    nursery = _kept[modules]
    if not nursery.fits(args[0], environment):
        return None
    return nursery.start(args, environment, stdout, stderr, cwd or pathlib.Path.cwd())


def _is_python(program: str) -> bool:
    try:
        with pathlib.Path(program).open('rb') as file:
            return program.endswith('.py') or b'python' in file.readline(200)
    except OSError:
        return False


# ----- in the nursery's process -----------------------------------------------------------


def _wait(end: socket.socket) -> dict[str, Any]:
    """Fork for each request; return it in the child. The nursery itself does not return."""
    waking, wake = socket.socketpair()
    wake.setblocking(False)
    waking.setblocking(False)
    signal.set_wakeup_fd(wake.fileno(), warn_on_full_buffer=False)
    signal.signal(signal.SIGCHLD, lambda *_: None)
    # Whoever interrupts the tests by Ctrl-C ends this one by the closed socket.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    children: dict[int, int] = {}
    while True:
        ready, _, _ = select.select([end, waking], [], [])
        if waking in ready:
            waking.recv(4096)
        _bury(children)
        if end not in ready:
            continue
        data, descriptors, _, _ = socket.recv_fds(end, _MOST_BYTES, 5)
        if not data:
            os._exit(0)  # and with it its children, by their death signal
        *standard, network, tell = descriptors
        pid = os.fork()
        if pid == 0:
            signal.set_wakeup_fd(-1)
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            signal.signal(signal.SIGINT, signal.default_int_handler)
            _LIBC.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
            for number, descriptor in enumerate(standard):
                os.dup2(descriptor, number)
            _move(network)
            for each in (end, waking, wake):
                each.detach()
            os.closerange(3, 1024)
            request: dict[str, Any] = json.loads(data)
            return request
        children[pid] = tell
        for descriptor in {*standard, network}:
            os.close(descriptor)
        end.send(str(pid).encode())


def _tell_tracer_of_forks() -> None:
    """
    Have LTTng, which rclpy loads where it is built with it, told of every fork.

    It has threads, which are not in a forked process; there it would crash at the end.
    """
    mapped = pathlib.Path('/proc/self/maps').read_text(encoding='utf-8')
    for library in set(re.findall(r'/\S*/liblttng-ust\S*', mapped)):
        functions = ctypes.CDLL(library)
        for prefix in ('', 'lttng_'):  # before LTTng 2.13, and since
            if hasattr(functions, f'{prefix}ust_before_fork'):
                signals = ctypes.create_string_buffer(128)  # a sigset_t
                before, parent, child = (
                    functools.partial(getattr(functions, f'{prefix}ust_{when}'), signals)
                    for when in ('before_fork', 'after_fork_parent', 'after_fork_child')
                )
                os.register_at_fork(before=before, after_in_parent=parent, after_in_child=child)


def _move(network: int) -> None:
    """Go to a network namespace, unless this process is in it."""
    with open(_NETWORK) as here:  # noqa: PTH123 - its descriptor
        if os.path.sameopenfile(network, here.fileno()):
            return
    if _LIBC.setns(network, _CLONE_NEWNET):
        raise OSError(ctypes.get_errno(), 'no way into the network namespace')


def _bury(children: dict[int, int]) -> None:
    """Tell of every child that has ended how it did."""
    for pid, tell in list(children.items()):
        ended, status = os.waitpid(pid, os.WNOHANG)
        if ended:
            with contextlib.suppress(OSError):  # nobody waits for it any more
                os.write(tell, str(os.waitstatus_to_exitcode(status)).encode())
            os.close(children.pop(pid))


def _become(request: dict[str, Any]) -> None:
    """Be a process that was started with these arguments and this environment, and run it."""
    os.chdir(request['cwd'])
    for name in set(os.environ) - set(request['environment']):
        del os.environ[name]
    os.environ.update(request['environment'])
    sys.argv = request['args']
    sys.path.insert(0, str(pathlib.Path(sys.argv[0]).parent))
    unbuffered = bool(os.environ.get('PYTHONUNBUFFERED'))
    sys.stdin = open(0, closefd=False)  # noqa: SIM115
    sys.stdout = _stream(1, unbuffered=unbuffered)
    sys.stderr = _stream(2, unbuffered=unbuffered, errors='backslashreplace')
    if pathlib.Path(sys.argv[0]).name == RACE_CONTROL:
        code = _sow()
        if code is not None:
            exec(code, {'__name__': '__main__'})  # noqa: S102 - as python -c
            return
    runpy.run_path(sys.argv[0], run_name='__main__')


def _sow() -> str | None:
    """Fork race control's seed; return, in the seed, what it is to run once that is known."""
    end, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    pid = os.fork()
    if pid:
        other.close()
        kart_client = importlib.import_module('evgp_rcs.kart_client')
        start = functools.partial(_Seed, pid, end)
        kart_client.subprocess = types.SimpleNamespace(**{**vars(subprocess), 'Popen': start})
        return None
    end.close()
    with other:
        data, descriptors, _, _ = socket.recv_fds(other, _MOST_BYTES, 1)
    if not data:
        os._exit(0)  # race control has ended without starting its kart server
    os.setsid()
    code, *path, ignored = json.loads(data)
    for number in ignored:  # as a program that is started; it inherits no other handler
        signal.signal(number, signal.SIG_IGN)
    sys.argv = ['-c', str(descriptors[0]), *path]
    return str(code)


class _Seed:
    """The process of the kart server, to be used as ``subprocess.Popen`` is."""

    def __init__(
        self, pid: int, end: socket.socket, args: Sequence[str], pass_fds: Sequence[int], **_: Any
    ) -> None:
        """Have the seed run `args`, which are ``python -c code descriptor path...``."""
        self.pid = pid
        self.returncode: int | None = None
        self._descriptor = os.pidfd_open(pid)
        _, _, code, _, *path = args
        ignored = [
            int(each)
            for each in signal.valid_signals()
            if signal.getsignal(each) is signal.SIG_IGN
        ]
        with end:
            socket.send_fds(end, [json.dumps([code, *path, ignored]).encode()], pass_fds)

    def kill(self) -> None:
        """End it as a crash does."""
        if self.returncode is None:
            signal.pidfd_send_signal(self._descriptor, signal.SIGKILL)

    def wait(self, timeout: float | None = None) -> int:
        """
        Return its exit code once it has ended.

        :raises subprocess.TimeoutExpired: if it has not ended by then.
        """
        if self.returncode is None:
            if not select.select([self._descriptor], [], [], timeout)[0]:
                raise subprocess.TimeoutExpired('kart server', timeout or 0.0)
            self.returncode = os.waitstatus_to_exitcode(os.waitpid(self.pid, 0)[1])
            os.close(self._descriptor)
        return self.returncode


def _stream(descriptor: int, *, unbuffered: bool, errors: str = 'strict') -> io.TextIOWrapper:
    raw = io.FileIO(descriptor, 'w', closefd=False)
    return io.TextIOWrapper(
        raw if unbuffered else io.BufferedWriter(raw),  # type: ignore[arg-type]
        encoding='utf-8',
        errors=errors,
        line_buffering=descriptor == 2,
        write_through=unbuffered,
    )


def _main() -> None:
    """Import, wait, and in each child run its program."""
    descriptor, *modules = sys.argv[1:]
    for module in modules:
        importlib.import_module(module)
    _load_messages()
    inspect.getmodule(inspect.currentframe())  # rclpy asks with the first line of a log
    _tell_tracer_of_forks()
    gc.collect()
    gc.freeze()  # what is here is shared with the children for as long as nobody touches it
    _become(_wait(socket.socket(fileno=int(descriptor))))


def _load_messages() -> None:
    """Load what a node loads with the first message of each kind."""
    for module in [each for name, each in sys.modules.items() if name.endswith(('.msg', '.srv'))]:
        for kind in list(vars(module).values()):
            load = getattr(type(kind), '__import_type_support__', None)
            if load is not None:
                load()


if __name__ == '__main__':
    _main()
