"""What is to be put in order: the visits of a tour, and the problem whose measurements they are, if they are some."""

from dataclasses import dataclass, replace

from cellwright.engine.model.tour import TourProblem
from cellwright.engine.pipelines.inspection import Partition
from cellwright.kb.diagnostics import InvalidInput, Source, unknown_name
from cellwright.kb.model.problem import Problem


@dataclass(frozen=True)
class Visits:
    """What is to be put in order: an instance, or the measurements of a problem, divided among the tools."""

    tours: TourProblem
    parts: Partition | None = None
    problem: Problem | None = None

    def ending(self, closed: bool | None, start: str = "", end: str = "") -> "Visits":
        """The same visits for a tour that is closed or not (None: as it was), with these first and last visits.

        Raises `InvalidInput` for names that no visit has.
        """
        asked = replace(
            self.tours,
            closed=self.tours.closed if closed is None else closed,
            start=_number(self.tours, start, "--start"),
            end=_number(self.tours, end, "--end"),
        )
        return replace(self, tours=asked)


def _number(problem: TourProblem, name: str, option: str) -> int | None:
    """The number of a visit."""
    names = [visit.name for visit in problem.visits]
    if name and name not in names:
        raise InvalidInput([unknown_name("visit", name, set(names), Source(option))])
    return names.index(name) if name else None
