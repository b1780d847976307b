# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
A watch that notices when another machine has race control's address, or this machine loses it.

Every race control runs this watch from start to end. At every interface through which karts reach
race control, the watch asks by ARP for race control's own address. Its questions are RFC 5227
probes, which do not change any cache. The watch also hears ARP packets in which other machines
claim the address, and notices when such an interface loses its cable or its address.

`Lookout` and everything above it are pure. `AddressWatch` is the thread around them. The watch
asks through a raw packet socket if this process may open one, and otherwise through ``arping``
(iputils-arping). If neither works, the watch cannot know who has the address. It does not ask on
the loopback interface, where there are no other machines.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
import contextlib
import ctypes
import errno
import ipaddress
import math
import os
import re
import select
import shutil
import socket
import struct
import subprocess
import threading
from typing import NamedTuple

from evgp_node.graph import EVERY
from evgp_node.network_cards import Card, card_news, cards, forget_news, LOOPBACK_CARD
from evgp_protocol import clock

ASK_EVERY = 0.5
"""Time between two questions, and maximum time between two checks of the interfaces, in seconds.
The kernel reports most changes at once, for example when a cable is plugged in again."""

HEARD_WITHIN = 1.0
"""Time within which another machine answers, in seconds. Race control waits this long before it
serves karts."""

ANNOUNCEMENTS = 5
"""Number of times that race control announces its address once no other machine has answered. It
does so more than once in case an announcement is lost. Until one arrives, machines may still send
to the previous owner of the address."""

MOST_BLIND = 5
"""Maximum number of consecutive failed checks of the interfaces. One more ends race control."""

MOST_HEARD = 1000
"""Maximum number of ARP packets read between two checks of the interfaces."""

_EVERYBODY = b'\xff' * 6
_NOBODY = bytes(6)
_PROTOCOL = 0x0806  # ETH_P_ARP
_PACKET = struct.Struct('!6s6sHHHBBH6s4s6s4s')
_FIXED = (_PROTOCOL, 1, 0x0800, 6, 4)  # IPv4 on Ethernet
_REQUEST = 1
_AMBIENT, _CLEAR_ALL = 47, 4  # PR_CAP_AMBIENT
_NOT_NOW = (errno.ENETDOWN, errno.ENODEV, errno.ENXIO, errno.ENOBUFS, errno.EAGAIN)


class AddressTakenError(RuntimeError):
    """Another machine has race control's address. The message says which machine."""


# ----- questions and claims -------------------------------------------------------------------


class Claim(NamedTuple):
    """
    A machine's claim, heard at an interface, that it has an address.

    :param alone: whether only the first answer was heard, so that others may be missing.
    """

    interface: str
    address: str
    hardware: str
    alone: bool = False


class Question(NamedTuple):
    """The question whether another machine at this interface has this IPv4 address."""

    address: str
    card: Card

    @property
    def can_be_asked(self) -> bool:
        """Return whether the interface takes ARP packets now."""
        return self.card.plugged and len(self.card.hardware) == len('00:00:00:00:00:00')


def packet(hardware: str, sender: str, address: str) -> bytes:
    """
    Return a broadcast ARP request for an address, from the interface with this hardware address.

    :param sender: 0.0.0.0 for a probe, or the same address as `address` for an announcement.
    """
    own = bytes.fromhex(hardware.replace(':', ''))
    addresses = socket.inet_aton(sender), _NOBODY, socket.inet_aton(address)
    return _PACKET.pack(_EVERYBODY, own, *_FIXED, _REQUEST, own, *addresses)


def claim_in(interface: str, data: bytes) -> Claim | None:
    """Return the claim in an ARP request or reply; None if the data contains no claim."""
    if len(data) < _PACKET.size:
        return None
    _, _, *fixed, _, hardware, sender, _, _ = _PACKET.unpack_from(data)
    if tuple(fixed) != _FIXED:
        return None
    return Claim(interface, socket.inet_ntoa(sender), hardware.hex(':'))


def to_be_asked(host: str, karts: Iterable[str], there: Sequence[Card]) -> tuple[Question, ...]:
    """
    Return one question for each interface and address through which karts reach race control.

    :param host: the address at which race control listens, or `EVERY`.
    """
    known = [ipaddress.IPv4Address(each) for each in karts]
    return tuple(
        Question(str(own.ip), card._replace(addresses=()))
        for card in there
        for own in card.addresses
        if card.name != LOOPBACK_CARD and not own.ip.is_loopback
        if str(own.ip) == host or (host == EVERY and any(each in own.network for each in known))
    )


# ----- what it means --------------------------------------------------------------------------


class Lookout:
    """Everything that the watch has found out about race control's addresses so far."""

    def __init__(self, asks: Callable[[Sequence[Card]], Sequence[Question]]) -> None:
        self._asks = asks
        self._asked: dict[Question, float] = {}  # since when, in seconds
        self._looked_at = -math.inf
        self._lost: dict[str, str] = {}
        self._own: frozenset[str] = frozenset()
        self._owned: frozenset[str] = frozenset()
        self._hidden = ''

    @property
    def cut_off(self) -> str:
        """
        Return why karts cannot reach race control, as a phrase; empty if no reason is known.

        A loss ends once the interface has returned and no other machine has answered there.
        """
        return '; '.join(self._lost.values())

    @property
    def not_known(self) -> str:
        """Return why it is unknown whether another machine has the address; empty if known."""
        for question in self._asked:
            address, card = question
            if not card.plugged:
                return (
                    f'{card.name} is down or has no cable, so race control cannot ask there who '
                    f'has {address}'
                )
            if not question.can_be_asked:
                return f'race control cannot ask by ARP at {card.name} who has {address}'
        if not self._asked:
            return 'no network interface has an address at which race control listens'
        return self._hidden

    @property
    def asked(self) -> list[Question]:
        """Return the questions that can be asked now."""
        return [each for each in self._asked if each.can_be_asked]

    def see(self, there: Sequence[Card], now: float) -> None:
        """Update what is known from the current interfaces at this time (s)."""
        # Keep the previous hardware addresses as well. A packet that this machine sent a moment
        # ago may arrive at another of its interfaces now.
        own = frozenset(each.hardware for each in there if each.name != LOOPBACK_CARD)
        self._own, self._owned = own, self._own
        kept = {
            (str(own.ip), card._replace(addresses=())) for card in there for own in card.addresses
        }
        for question in self._asked:
            if question.card.plugged and question not in kept:
                self._lost[question.address] = _what_is_lost(question, there)
        self._asked = {
            each: self._asked.get(each, now) if each in kept else now for each in self._asks(there)
        }
        for question in self.asked:
            if now - self._asked[question] >= HEARD_WITHIN:
                self._lost.pop(question.address, None)

    def due(self, now: float) -> list[tuple[Question, bool]]:
        """
        Return the questions to ask now, each with whether to announce the address as well.

        The watch does not make up for questions that it missed.
        """
        before, self._looked_at = self._looked_at, now
        return [
            (question, 0.0 <= now - since - HEARD_WITHIN < ANNOUNCEMENTS * ASK_EVERY)
            for question, since in self._asked.items()
            if question.can_be_asked
            and (now - since) // ASK_EVERY != (before - since) // ASK_EVERY
        ]

    def hear(self, claim: Claim) -> str:
        """Return a sentence about the other machine that made a claim; empty if this one did."""
        if (claim.address, claim.interface) not in [
            (each.address, each.card.name) for each in self._asked
        ]:
            return ''
        if claim.hardware not in self._own | self._owned:
            return (
                f'another machine ({claim.hardware}) on {claim.interface} has the address '
                f'{claim.address}'
            )
        if claim.alone:
            self._hidden = (
                f'another interface of this machine ({claim.hardware}) is on the same network as '
                f'{claim.interface}, and arping hears only the first answer'
            )
        return ''


def _what_is_lost(question: Question, there: Sequence[Card]) -> str:
    address, before = question
    card = next((each for each in there if each.name == before.name), None)
    if card is None:
        return f'the interface {before.name} is gone'
    if not card.has(address):
        return f'{card.name} no longer has the address {address}'
    return f'{card.name} has lost its cable or its WLAN'


# ----- asking ---------------------------------------------------------------------------------


class Asker:
    """
    The way to ask at an interface, and to hear who claims an address.

    This base class is for a process that cannot ask at all.

    :ivar trouble: why it cannot ask, as a phrase. Empty if it can.
    :ivar asked: number of questions asked so far.
    :ivar files: file descriptors that become readable when there are claims.
    """

    def __init__(self) -> None:
        self.trouble = (
            'this program may not open a raw packet socket (CAP_NET_RAW), and there is no arping '
            '(apt-get install iputils-arping)'
        )
        self.asked = 1
        self.files: tuple[int, ...] = ()

    def ask(self, question: Question) -> None:
        """Ask whether another machine has the address. The answers appear in `claims`."""

    def announce(self, question: Question) -> None:
        """Announce at the interface that this machine has the address."""

    def claims(self) -> list[Claim]:
        """Return the claims heard since the last call. This method does not wait."""
        return []

    def close(self) -> None:
        """Close the socket, or end the programs that ask."""


class _RawSocket(Asker):
    """An asker with a raw socket. It hears every ARP packet at any interface."""

    def __init__(self) -> None:
        """Open the socket, or raise an OSError if this process may not."""
        super().__init__()
        kind = socket.SOCK_RAW | socket.SOCK_NONBLOCK
        self._socket = socket.socket(socket.AF_PACKET, kind, socket.htons(_PROTOCOL))
        self.trouble, self.asked = '', 0
        self.files = (self._socket.fileno(),)
        # The processes that this one starts do not need this right, and strangers can reach some
        # of them.
        ctypes.CDLL(None).prctl(_AMBIENT, _CLEAR_ALL, 0, 0, 0)

    def ask(self, question: Question) -> None:
        self._send(question, EVERY)
        self.asked += 1

    def announce(self, question: Question) -> None:
        self._send(question, question.address)

    def _send(self, question: Question, sender: str) -> None:
        address, card = question
        try:
            self._socket.sendto(packet(card.hardware, sender, address), (card.name, _PROTOCOL))
            self.trouble = ''
        except OSError as error:
            if error.errno not in _NOT_NOW:  # the next check of the interfaces shows these
                self.trouble = f'race control cannot ask at {card.name}: {error.strerror}'

    def claims(self) -> list[Claim]:
        found = []
        with contextlib.suppress(OSError):  # above all BlockingIOError
            for _ in range(MOST_HEARD):
                data, (interface, *_) = self._socket.recvfrom(128)
                claim = claim_in(interface, data)
                if claim is not None:
                    found.append(claim)
        return found

    def close(self) -> None:
        self._socket.close()


class _Arping(Asker):
    """An asker with the program ``arping``. It may have a right that this process lacks."""

    def __init__(self) -> None:
        """Look for the program, or raise an OSError if it is not installed."""
        if shutil.which('arping') is None:
            raise FileNotFoundError(errno.ENOENT, 'arping is not installed')
        super().__init__()
        self._asking: list[tuple[Question, subprocess.Popen[str]]] = []
        self._announcing: list[subprocess.Popen[str]] = []
        self.trouble, self.asked = '', 0

    def ask(self, question: Question) -> None:
        self._asking.append((question, self._run('-D', question)))

    def announce(self, question: Question) -> None:
        self._announcing.append(self._run('-U', question))

    def _run(self, how: str, question: Question) -> subprocess.Popen[str]:
        address, card = question
        return subprocess.Popen(
            ['arping', how, '-c', '1', '-w', '1', '-I', card.name, address],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors='replace',
            start_new_session=True,  # Ctrl-C in a terminal must not reach arping
            env={**os.environ, 'LC_ALL': 'C'},
        )

    def claims(self) -> list[Claim]:
        self._announcing = [each for each in self._announcing if each.poll() is None]
        found = []
        ended = [each for each in self._asking if each[1].poll() is not None]
        self._asking = [each for each in self._asking if each not in ended]
        self.asked += len(ended)
        for (address, card), asked in ended:
            said, _ = asked.communicate()
            # After an error, arping's exit code is the same as after an answer.
            answer = re.search(r'(?:reply|request) from .*?\[([\w:]{17})\]', said, re.IGNORECASE)
            if answer is not None:
                found.append(Claim(card.name, address, answer[1].lower(), alone=True))
                self.trouble = ''
            elif asked.returncode == 0 and 'Received 0 response' in said:
                self.trouble = ''
            elif card.plugged:
                last = (said.strip().splitlines() or ['it printed nothing'])[-1]
                self.trouble = f'arping cannot ask on {card.name} who has {address}: {last}'
        return found

    def close(self) -> None:
        for each in (*(asking for _, asking in self._asking), *self._announcing):
            each.kill()
            each.communicate()


def _an_asker() -> Asker:
    for kind in (_RawSocket, _Arping):
        with contextlib.suppress(OSError):
            return kind()
    return Asker()


# ----- the thread -----------------------------------------------------------------------------


class AddressWatch:
    """
    The watch. It runs in its own thread from the start.

    :param asks: a function that returns the questions to ask at the given interfaces.
    :param announces: whether this machine has the address and must announce it.
    :ivar cut_off: why karts cannot reach race control now, as a phrase. Empty if they can.
    :ivar answer: a sentence about the other machine that has the address. Empty if none is known.
    :ivar error: the error that ended the watch. None if there is none.
    """

    def __init__(
        self, asks: Callable[[Sequence[Card]], Sequence[Question]], *, announces: bool = True
    ) -> None:
        self._announces = announces
        self._asker = _an_asker()
        self._news = card_news()
        self._lookout = Lookout(asks)
        self._there = cards()
        self._lookout.see(self._there, clock.now())
        self._began = clock.now()
        self.cut_off = self.answer = ''
        self.error: BaseException | None = None
        self._on_news: Callable[[], object] | None = None
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name='address', daemon=True)
        self._thread.start()

    def first_look(self, seconds: float = HEARD_WITHIN) -> str:
        """
        Wait until another machine with the address would have answered, if the watch can ask.

        :param seconds: time from the start of the watch within which another machine would answer,
            in seconds.
        :return: why it is unknown whether another machine has the address, as a phrase; empty if
            no other machine has it.
        :raises AddressTakenError: if another machine has the address.
        :raises BaseException: the error that ended the watch.
        """
        until = self._began + seconds
        while self._thread.is_alive() and self._lookout.asked:
            # arping may be slow to start.
            now = clock.now()
            if now >= until and (self._asker.asked or now >= until + seconds):
                break
            self._thread.join(0.05)  # it ends with an answer or an error
        if self.error is not None:
            raise self.error
        if self.answer:
            raise AddressTakenError(self.answer)
        return self._lookout.not_known or self._asker.trouble

    def tell(self, on_news: Callable[[], object]) -> None:
        """Call `on_news` in the watch's thread when `cut_off`, `answer` or `error` changes."""
        self._on_news = on_news
        if self.cut_off or self.answer or self.error:
            on_news()

    def close(self) -> None:
        """Make the thread end. This takes at most `ASK_EVERY` seconds."""
        self._closing.set()

    def _run(self) -> None:
        try:
            self._watch()
        except BaseException as error:  # noqa: BLE001 - the node ends the process
            self.error = error
            self._notify()
        finally:
            self._asker.close()
            self._news.close()

    def _watch(self) -> None:
        lookout, asker = self._lookout, self._asker
        there, blind = self._there, 0
        while not (self._closing.is_set() or self.answer):
            for question, announce in lookout.due(clock.now()):
                asker.ask(question)
                if announce and self._announces:
                    asker.announce(question)
            select.select([self._news.fileno(), *asker.files], [], [], ASK_EVERY)
            forget_news(self._news)
            try:
                there, blind = cards(), 0
            except OSError:  # most likely no file descriptor is left
                blind += 1
                if blind > MOST_BLIND:
                    raise
            lookout.see(there, clock.now())
            self.answer = next(filter(None, map(lookout.hear, asker.claims())), '')
            # Before `tell`, keep a loss even if it has ended, so that `on_news` still reports it.
            cut_off = lookout.cut_off
            if cut_off != self.cut_off and (cut_off or self._on_news is not None):
                self.cut_off = cut_off
                self._notify()
        if self.answer:
            self._notify()

    def _notify(self) -> None:
        if self._on_news is not None:
            self._on_news()
