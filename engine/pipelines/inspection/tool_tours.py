"""From measurements to tours: rules assign tools and stations, the sequencer orders the visits.

Stations are few, and a change of station takes longer than any way at one. So the smallest set of
stations that serves all measurements is found first; a measurement that several of them serve
belongs to the one that comes first in the set.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from itertools import combinations

from cellwright.engine.model.part_measurements import chooses_tools, measurements_of
from cellwright.engine.model.tour_problem import TourProblem, Visit
from cellwright.engine.pipelines.inspection.measurement_points import positions_in
from cellwright.engine.pipelines.inspection.tour_demands import TourDemands, of_facts, with_demands
from cellwright.engine.pipelines.inspection.travel_costs import has_table, open_tour
from cellwright.kb.asp import Grounder
from cellwright.kb.asp.static_facts import evaluate_statics
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, unknown_name
from cellwright.kb.model.name_conventions import CONVENTION_BY_NAME, Conventions
from cellwright.kb.model.operator_amounts import Facts
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Number, Term, Text

# stations of which every set is tried; of more, the one that serves most of the rest is taken
# next
MAX_STATION_SETS = 12


def stations_of(
    facts: Facts, words: Conventions
) -> tuple[dict[str, str], dict[tuple[str, str], int]]:
    """The station of each measurement that needs one, and the cost of each change of stations,
    as a way in micrometres.
    """
    served: dict[str, set[str]] = {}
    for station, name in facts(words.serves, 2):
        served.setdefault(str(station), set()).add(str(name))
    chosen = chosen_stations(served)
    stations = {name: station for station in reversed(chosen) for name in sorted(served[station])}
    ways = ((str(a), str(b), amount) for a, b, amount in facts(words.shift, 3))
    return stations, {(a, b): amount.value for a, b, amount in ways if isinstance(amount, Number)}


def chosen_stations(served: Mapping[str, set[str]]) -> tuple[str, ...]:
    """The fewest stations that together serve all that any serves, in order of their names."""
    everything, names = set().union(*served.values()), sorted(served)
    if len(names) > MAX_STATION_SETS:
        return _one_by_one(served, everything)
    for count in range(len(names) + 1):
        for some in combinations(names, count):
            if set().union(*(served[station] for station in some)) == everything:
                return some
    return tuple(names)


def _one_by_one(served: Mapping[str, set[str]], everything: set[str]) -> tuple[str, ...]:
    chosen: list[str] = []
    unserved = set(everything)
    while unserved:
        best = max(sorted(served), key=lambda station: len(served[station] & unserved))
        chosen.append(best)
        unserved -= served[best]
    return tuple(sorted(chosen))


NO_TOOL = "no tool takes a measurement of this kind"
UNKNOWN_POSITION = "its position is not known"


@dataclass(frozen=True, slots=True)
class ToolPartition:
    """The measurements of a problem: those to be made, by tool; those done; those impossible,
    with the reason.
    """

    groups: Mapping[str, tuple[str, ...]]
    done: tuple[str, ...]
    impossible: Mapping[str, str]


def partition_by_tool(problem: Problem, placed: Collection[str] | None = None) -> ToolPartition:
    """The measurements by tool, as the rules of the domain choose. Raises `InvalidInput`.

    A measurement without a `position` is impossible, unless a table gives the travel times. If
    `placed` is given, it names the measurements whose place is known from another source, and the
    `position` facts are not consulted.
    """
    require_choice(problem)
    words, grounder, measurements = (
        problem.domain.conventions,
        _ground_facts(problem),
        measurements_of(problem),
    )
    choices = sorted(grounder.atoms(words.chosen, 2), key=str, reverse=True)
    chosen = {str(name): str(tool) for tool, name in choices}
    reasons = _refusal_reasons(grounder, words)
    measured = {str(fact.arguments[-1]) for fact in problem.initial if fact.name == words.measured}
    done = tuple(name for name in measurements if words.place(name) in measured)
    not_done = [name for name in measurements if name not in set(done)]
    given_rows = grounder.column(words.position, 4, 0)
    located = set(
        measurements
        if has_table(problem, grounder.atoms)
        else given_rows
        if placed is None
        else placed
    )
    tools = sorted({chosen[name] for name in not_done if name in chosen})
    groups = {
        tool: tuple(n for n in not_done if chosen.get(n) == tool and n in located) for tool in tools
    }
    impossible = {
        name: UNKNOWN_POSITION if name in chosen else "; ".join(reasons.get(name, [NO_TOOL]))
        for name in not_done
        if name not in chosen or name not in located
    }
    return ToolPartition({tool: names for tool, names in groups.items() if names}, done, impossible)


def require_choice(problem: Problem) -> None:
    """Refuse a problem whose domain does not choose tools for measurements.

    Raises `InvalidInput`.
    """
    if chooses_tools(problem.domain):
        return
    words = problem.domain.conventions
    chosen, refused = CONVENTION_BY_NAME["chosen"], CONVENTION_BY_NAME["refused"]
    statics = f"{chosen.written(words.chosen)} and {refused.written(words.refused)}"
    hint = f"declare the statics {statics}, as bulkhead does"
    raise InvalidInput(
        [Diagnostic(Source(problem.path), "K405", "the domain chooses no tools", hint)]
    )


def _ground_facts(problem: Problem) -> Grounder:
    return evaluate_statics(problem)


def _refusal_reasons(grounder: Grounder, words: Conventions) -> dict[str, list[str]]:
    """Why measurements cannot be made, by name: their `impossible` fact, or else why each tool
    is `refused`.
    """
    reasons = {str(name): [_plain_text(why)] for name, why in grounder.atoms(words.impossible, 2)}
    refusals: dict[str, list[str]] = {}
    refused = ((str(m), str(t), _plain_text(w)) for t, m, w in grounder.atoms(words.refused, 3))
    for name, tool, why in sorted(refused):
        refusals.setdefault(name, []).append(f"{tool} is {why}")
    return refusals | reasons


def _plain_text(term: Term) -> str:
    return term.value if isinstance(term, Text) else str(term)


def tour_problem(
    problem: Problem, parts: ToolPartition, more: TourDemands = TourDemands(), timed: bool = True
) -> TourProblem:
    """The tour of all measurements that some tool takes, with ways and tool changes as the domain
    says.

    Ways are straight lines in micrometres, or the times of a table. With windows and durations,
    which the problem or `more` demands, they are times in any case; unless the tour is not `timed`,
    and leaves these out. Raises `InvalidInput`.
    """
    words, grounder = problem.domain.conventions, _ground_facts(problem)
    where = positions_in(grounder, words)
    changes = {
        (str(a), str(b)): int(_term_number(amount))
        for a, b, amount in grounder.atoms(words.change, 3)
    }
    phases = _alignment_phases(grounder, words)
    stations, shifts = stations_of(grounder.atoms, words)
    visits = (
        Visit(
            name, where.get(name), tool, phase=phases.get(name, 0), station=stations.get(name, "")
        )
        for tool, names in parts.groups.items()
        for name in names
    )
    demands = of_facts(grounder.atoms, words, Source(problem.path)).and_also(more)
    demands = demands if timed else TourDemands(before=demands.before)
    tours = open_tour(
        problem,
        problem.name,
        tuple(visits),
        changes,
        facts=grounder.atoms,
        in_time=demands.need_times,
    )
    return with_demands(replace(tours, shifts=shifts), demands)


def _alignment_phases(grounder: Grounder, words: Conventions) -> dict[str, int]:
    """The steps of the alignment, as phases below 0: the measurements that are no part of it
    come last.
    """
    steps = {
        str(name): int(_term_number(step)) for name, step in grounder.atoms(words.alignment, 2)
    }
    last = max(steps.values(), default=0)
    return {name: step - last - 1 for name, step in steps.items()}


def _term_number(term: Term) -> float:
    return term.value if isinstance(term, Number) else 0.0


@dataclass(frozen=True)
class TourVisits:
    """What is to be put in order: an instance, or the measurements of a problem, divided among
    the tools.
    """

    tours: TourProblem
    parts: ToolPartition | None = None
    problem: Problem | None = None
    warnings: tuple[Diagnostic, ...] = ()

    def ending(self, closed: bool | None, start: str = "", end: str = "") -> "TourVisits":
        """The same visits for a tour that is closed or not (None: as it was), with these first and
        last visits.

        Raises `InvalidInput` for names that no visit has.
        """
        asked = replace(
            self.tours,
            closed=self.tours.closed if closed is None else closed,
            start=_visit_number(self.tours, start, "--start"),
            end=_visit_number(self.tours, end, "--end"),
        )
        return replace(self, tours=asked)


def _visit_number(problem: TourProblem, name: str, option: str) -> int | None:
    """The number of a visit."""
    names = [visit.name for visit in problem.visits]
    if name and name not in names:
        raise InvalidInput([unknown_name("visit", name, set(names), Source(option))])
    return names.index(name) if name else None
