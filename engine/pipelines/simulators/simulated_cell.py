"""Interfaces between the simulated driver and the cell that it drives, physical or not."""

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any, Protocol

from cellwright.kb.model.fault_model import FaultTest
from cellwright.kb.terms import Atom, Function


class PhysicalBody(Protocol):
    """What a cell is made of, where steps of arms are really moved: it knows whether they have
    worked.
    """

    def carries_out(
        self, step: Function, before: Collection[Atom], after: Collection[Atom]
    ) -> bool:
        """Take a step; whether it has led from the facts before it to those after it."""
        ...

    def met(self) -> Mapping[str, Any]:
        """What has stopped the arm in the last step, as the data of a reply; empty if nothing
        has: the arm is where it was.
        """
        ...

    def misfit(
        self, facts: Collection[Atom], before: Collection[Atom], after: Collection[Atom]
    ) -> int:
        """After such a step, in how many bodies some facts are wrong."""
        ...

    def reading(self, sensor: str) -> str:
        """What a sensor reads now; empty for one that it has not."""
        ...

    def tells(self, sensor: str, shown: str) -> str:
        """The outcome of a test that a reading means."""
        ...

    def failed(self, facts: Collection[Atom]) -> None:
        """A step has failed, and these facts are true now."""
        ...

    def repaired(self, before: Collection[Atom], after: Collection[Atom]) -> None:
        """A repair has helped, and has led from some facts to others."""
        ...


class SimulatedCell(Protocol):
    """What the simulated driver drives: a cell that takes commands when they end, and says how
    they ended.
    """

    def take(self, text: str, expects: str, part: Sequence[float] = ()) -> str | None:
        """Carry out a step with the part believed to lie there: its reply; None if none ever
        comes.
        """
        ...

    def told(self) -> Mapping[str, Any]:
        """What the reply to the last step tells beside its text."""
        ...

    def missing(self, looked_at: Sequence[str]) -> str:
        """The first of some facts that is not so; empty if all are."""
        ...

    def answer(self, action: str) -> str:
        """The outcome of a test or a repair."""
        ...

    def say(self, choices: Sequence[str]) -> str:
        """What a person answers who looks into the cell."""
        ...


def reading_by(body: PhysicalBody | None, about: Function) -> str:
    """What the sensor reads that a step or a fact names first; empty if it names none of the
    cell.
    """
    if body is None or not about.arguments:
        return ""
    return body.reading(str(about.arguments[0]))


def told_by(body: PhysicalBody, test: FaultTest, usual: Callable[[str, str], bool]) -> str:
    """The outcome of a test that is made by a sensor of a physical cell; empty if the cell cannot
    tell.

    `usual` says whether a sensor would have this reading had the step worked: that is the usual
    outcome.
    """
    if test.by is None or not (shown := reading_by(body, test.by)):
        return ""
    sensor = str(test.by.arguments[0])
    for outcome in (shown, body.tells(sensor, shown)):
        if outcome in test.outcomes:
            return outcome
    return test.otherwise if usual(sensor, shown) else ""
