"""A run of a record, as the report and the results need it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from evgp_rcs.inputs import InputsError, Setup
from evgp_rcs.record import RecordedEvent, Session
from evgp_rcs.report.model import Account, read
from evgp_rcs.runs import Runs


@dataclass(frozen=True)
class OfRun:
    """
    What a record has of a run.

    :param rules: the version of the rules; empty: not recorded.
    :param setup: with what the rules began; None: not recorded, or of another version.
    """

    happened: Sequence[RecordedEvent]
    rules: str
    setup: Setup | None

    def account(self) -> Account:
        """Return what it says."""
        if self.setup is None:
            return read(self.happened)
        teams = {kart.number: kart.team for kart in self.setup.karts}
        return read(self.happened, teams, self.setup.heats)


def read_run(runs: Runs, run: Session) -> OfRun:
    """Read a run; what is damaged of it, it has not."""
    happened = runs.events(run)
    rules, text = runs.setup(run) or ('', '')
    try:
        return OfRun(happened, rules, Setup.from_json(text))
    except InputsError:
        return OfRun(happened, rules, None)
