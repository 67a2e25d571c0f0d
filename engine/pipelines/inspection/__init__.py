"""From measurements to tours: rules assign the measurements to tools, and the sequencer orders them.

`cellwright.kb.model.conventions` lists the predicates that such a domain declares. The main ones: the tool that is `chosen` for a
measurement, the tools that are `refused` for it, its `position` in micrometres, and the cost of a `change` of tools, as a
distance in micrometres.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

from cellwright.engine.model.measurements import chooses_tools, measurements_of
from cellwright.engine.model.tour import TourProblem, Visit
from cellwright.engine.pipelines.inspection.demands import Demands, of_facts, with_demands
from cellwright.engine.pipelines.inspection.stations import stations_of
from cellwright.engine.pipelines.inspection.ways import has_table, ordered
from cellwright.engine.pipelines.points import positions_in
from cellwright.kb.asp import Grounder
from cellwright.kb.asp.statics import evaluated
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.model.conventions import CONVENTIONS, Conventions
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import Number, Term, Text

NO_TOOL = "no tool takes a measurement of this kind"
NO_POSITION = "its position is not known"


@dataclass(frozen=True, slots=True)
class Partition:
    """The measurements of a problem: those to be made, by tool; those done; those impossible, with the reason."""

    groups: Mapping[str, tuple[str, ...]]
    done: tuple[str, ...]
    impossible: Mapping[str, str]


def partition(problem: Problem, placed: Collection[str] | None = None) -> Partition:
    """The measurements by tool, as the rules of the domain choose. Raises `InvalidInput`.

    A measurement without a `position` is impossible, unless a table gives the travel times. If `placed` is given, it names the measurements whose place is known
    from another source, and the `position` facts are not consulted.
    """
    require_choice(problem)
    words, grounder, measurements = problem.domain.conventions, _grounded(problem), measurements_of(problem)
    choices = sorted(grounder.atoms(words.chosen, 2), key=str, reverse=True)
    chosen = {str(name): str(tool) for tool, name in choices}
    reasons = _reasons(grounder, words)
    measured = {str(fact.arguments[-1]) for fact in problem.initial if fact.name == words.measured}
    done = tuple(name for name in measurements if words.place(name) in measured)
    left = [name for name in measurements if name not in set(done)]
    given = grounder.column(words.position, 4, 0)
    located = set(measurements if has_table(problem, grounder.atoms) else given if placed is None else placed)
    tools = sorted({chosen[name] for name in left if name in chosen})
    groups = {tool: tuple(n for n in left if chosen.get(n) == tool and n in located) for tool in tools}
    impossible = {
        name: NO_POSITION if name in chosen else "; ".join(reasons.get(name, [NO_TOOL]))
        for name in left
        if name not in chosen or name not in located
    }
    return Partition({tool: names for tool, names in groups.items() if names}, done, impossible)


def require_choice(problem: Problem) -> None:
    """Refuse a problem whose domain does not choose tools for measurements. Raises `InvalidInput`."""
    if chooses_tools(problem.domain):
        return
    words = problem.domain.conventions
    chosen, refused = CONVENTIONS["chosen"], CONVENTIONS["refused"]
    statics = f"{chosen.written(words.chosen)} and {refused.written(words.refused)}"
    hint = f"declare the statics {statics}, as bulkhead does"
    raise InvalidInput([Diagnostic(Source(problem.path), "K405", "the domain chooses no tools", hint)])


def _grounded(problem: Problem) -> Grounder:
    return evaluated(problem)


def _reasons(grounder: Grounder, words: Conventions) -> dict[str, list[str]]:
    """Why measurements cannot be made, by name: their `impossible` fact, or else why each tool is `refused`."""
    found = {str(name): [_plain(why)] for name, why in grounder.atoms(words.impossible, 2)}
    told: dict[str, list[str]] = {}
    refused = ((str(m), str(t), _plain(w)) for t, m, w in grounder.atoms(words.refused, 3))
    for name, tool, why in sorted(refused):
        told.setdefault(name, []).append(f"{tool} is {why}")
    return told | found


def _plain(term: Term) -> str:
    return term.value if isinstance(term, Text) else str(term)


def tour_problem(
    problem: Problem, parts: Partition, more: Demands = Demands(), timed: bool = True
) -> TourProblem:
    """The tour of all measurements that some tool takes, with ways and tool changes as the domain says.

    Ways are straight lines in micrometres, or the times of a table. With windows and durations, which the problem or
    `more` demands, they are times in any case; unless the tour is not `timed`, and leaves these out. Raises
    `InvalidInput`.
    """
    words, grounder = problem.domain.conventions, _grounded(problem)
    where = positions_in(grounder, words)
    changes = {(str(a), str(b)): int(_number(way)) for a, b, way in grounder.atoms(words.change, 3)}
    phases = _phases(grounder, words)
    stations, shifts = stations_of(grounder.atoms, words)
    visits = (
        Visit(name, where.get(name), tool, phase=phases.get(name, 0), station=stations.get(name, ""))
        for tool, names in parts.groups.items()
        for name in names
    )
    demands = of_facts(grounder.atoms, words, Source(problem.path)).and_also(more)
    demands = demands if timed else Demands(before=demands.before)
    tours = ordered(
        problem, problem.name, tuple(visits), changes, facts=grounder.atoms, in_time=demands.need_times
    )
    return with_demands(replace(tours, shifts=shifts), demands)


def _phases(grounder: Grounder, words: Conventions) -> dict[str, int]:
    """The steps of the alignment, as phases below 0: the measurements that are no part of it come last."""
    steps = {str(name): int(_number(step)) for name, step in grounder.atoms(words.alignment, 2)}
    last = max(steps.values(), default=0)
    return {name: step - last - 1 for name, step in steps.items()}


def _number(term: Term) -> float:
    return term.value if isinstance(term, Number) else 0.0
