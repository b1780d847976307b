"""What the client's threads hear, handed over to the Qt thread by queued signals."""

from __future__ import annotations

from evgp_rcs_console.commands import Order
from evgp_rcs_console.qt import QtCore, Signal
from evgp_rcs_console.snapshot import Answer, Event, Race
from evgp_rcs_console.standing import Standing


class Inbox(QtCore.QObject):
    """A ``Listener`` of the client whose news arrive in the Qt thread."""

    race = Signal(object, float, bool)
    event = Signal(object)
    answer = Signal(object, object)
    pressing = Signal(object)

    def on_race(self, race: Race, at: float, two: bool) -> None:
        """Hand over a snapshot."""
        self.race.emit(race, at, two)

    def on_event(self, event: Event) -> None:
        """Hand over an event."""
        self.event.emit(event)

    def on_answer(self, order: Order, answer: Answer) -> None:
        """Hand over an answer."""
        self.answer.emit(order, answer)

    def on_pressing(self, stops: tuple[Standing, ...]) -> None:
        """Hand over the stops that race control has not accepted yet."""
        self.pressing.emit(stops)
