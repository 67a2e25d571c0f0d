"""How long things stay in places where they may not stay for long (`longest_stay`), and what is said where it is too long."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from cellwright.kb.model.plan import StepId

LISTED = 6  # things that are named


@dataclass(frozen=True, slots=True)
class Stay:
    """What one step brings may stay for so many units of time until another takes it: the `thing` in the `place`.

    What is there when the plan begins has the source 0, and `since_ms` on the run's clock.
    """

    source: StepId
    target: StepId
    most: int
    since_ms: int | None = None
    thing: str = ""
    place: str = ""


@dataclass(frozen=True, slots=True)
class Overstay:
    """A thing that stays in a place longer than the most that is allowed there, in the domain's unit of time."""

    thing: str
    place: str
    lasts: int
    most: int

    def entry(self) -> dict[str, Any]:
        """The same for JSON."""
        return {"thing": self.thing, "place": self.place, "lasts": self.lasts, "longest_stay": self.most}


def lines(found: Sequence[Overstay], unit: str) -> Iterator[str]:
    """What stays too long, in words, and what to do about it; nothing if nothing does."""
    if not found:
        return
    named = [f"{o.thing} in {o.place} for {o.lasts} {unit}, at most {o.most}" for o in found[:LISTED]]
    more = len(found) - LISTED
    listed = "; ".join(named) + (f"; and {more} more (--format json has all)" if more > 0 else "")
    yield f"Longer than longest_stay allows: {listed}."
    yield "Allow more time there, ask for less of what is done there, or change what takes things away."
