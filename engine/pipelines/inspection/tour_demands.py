"""What a tour must keep: time windows, durations, and which visit comes before which.

A problem gives them as facts, the command line as options; both are counted together.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from graphlib import CycleError, TopologicalSorter
from itertools import pairwise

from cellwright.engine.model.part_measurements import measurements_of
from cellwright.engine.model.tour_problem import ENDLESS_WINDOW, TourProblem, Visit
from cellwright.kb.asp.static_facts import evaluate_statics
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, unknown_name
from cellwright.kb.model.name_conventions import Conventions
from cellwright.kb.model.operator_amounts import MAX_AMOUNT, Facts
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.numbers import is_count
from cellwright.kb.terms import Function, Number, Term

Window = tuple[int, int | None]


@dataclass(frozen=True, slots=True)
class TourDemands:
    """Windows (earliest and latest beginning, None if any), durations and pairs (first,
    second), by names of visits.
    """

    windows: Mapping[str, Window] = field(default_factory=dict)
    lasts: Mapping[str, int] = field(default_factory=dict)
    before: tuple[tuple[str, str], ...] = ()

    def and_also(self, more: "TourDemands") -> "TourDemands":
        """All demands of both; where both speak of the same visit, those of `others`."""
        return TourDemands(
            {**self.windows, **more.windows},
            {**self.lasts, **more.lasts},
            tuple(dict.fromkeys((*self.before, *more.before))),
        )

    @property
    def need_times(self) -> bool:
        """Whether costs must be times."""
        return bool(self.windows) or bool(self.lasts)


def of_facts(facts: Facts, words: Conventions, where: Source) -> TourDemands:
    """The demands of the static facts of a problem.

    Raises `InvalidInput` if a measurement has two windows or durations.
    """
    windows = _numbers_by_name(words.window, facts(words.window, 3), where)
    lasts = _numbers_by_name(words.lasts, facts(words.lasts, 2), where)
    pairs = sorted((str(first), str(second)) for first, second in facts(words.before, 2))
    return TourDemands(
        {name: (times[0], times[1]) for name, times in windows.items()},
        {name: duration[0] for name, duration in lasts.items()},
        tuple(pairs),
    )


def _numbers_by_name(
    predicate: str, facts: Iterable[tuple[Term, ...]], where: Source
) -> dict[str, tuple[int, ...]]:
    """The numbers that a predicate gives to each name."""
    numbers_by_name: dict[str, tuple[int, ...]] = {}
    for name, *values in facts:
        numbers = _demanded_numbers(predicate, name, values, where)
        if numbers_by_name.setdefault(str(name), numbers) != numbers:
            message = (
                f"{name} has two values of {predicate}: "
                f"{_join_values(numbers_by_name[str(name)])} and {_join_values(numbers)}"
            )
            raise InvalidInput([Diagnostic(where, "K115", message, "keep one of them")])
    return numbers_by_name


def _demanded_numbers(
    predicate: str, name: Term, values: Sequence[Term], where: Source
) -> tuple[int, ...]:
    numbers = tuple(value.value for value in values if isinstance(value, Number))
    if len(numbers) == len(values) and min(numbers) >= 0 and list(numbers) == sorted(numbers):
        return numbers
    message = f"{predicate} of {name} is {_join_values(values)}"
    hint = "write times of 0 or more; a window has the earliest and then the latest"
    raise InvalidInput([Diagnostic(where, "K115", message, hint)])


def _join_values(values: Sequence[object]) -> str:
    return ", ".join(map(str, values))


def demand_findings(problem: Problem) -> list[Diagnostic]:
    """What is wrong with the windows, durations and precedence that the facts of a problem
    demand of its tours.
    """
    words, where = problem.domain.conventions, Source(problem.path)
    if not {words.window, words.lasts, words.before} & set(problem.domain.predicates):
        return []
    grounder = evaluate_statics(problem)
    try:
        demands = of_facts(grounder.atoms, words, where)
    except InvalidInput as error:
        return list(error.diagnostics)
    circle = _find_cycle(demands.before)
    if not circle:
        return []
    message = f"{words.before} forms a cycle: {' before '.join(circle)}"
    return [Diagnostic(where, "K115", message, "remove one of these facts")]


def _find_cycle(pairs: Sequence[tuple[str, str]]) -> list[str]:
    """Names of which each comes before the next, and the last is the first; empty if there are
    none.
    """
    earlier: dict[str, list[str]] = {}
    for first, second in pairs:
        earlier.setdefault(second, []).append(first)
    try:
        TopologicalSorter(earlier).prepare()
    except CycleError as error:
        return [str(name) for name in error.args[1]]
    return []


def of_options(windows: Sequence[str], lasts: Sequence[str], before: Sequence[str]) -> TourDemands:
    """The demands that options spell: `m3=10..90`, `m3=4` and `m1,m2,m3`. Raises `InvalidInput`."""
    return TourDemands(
        dict(_spelled_window(spelled) for text in windows for spelled in text.split(",")),
        dict(_spelled_time(spelled) for text in lasts for spelled in text.split(",")),
        tuple(pair for text in before for pair in _chain_pairs(text)),
    )


def _spelled_window(text: str) -> tuple[str, Window]:
    name, _, span = text.partition("=")
    first, dots, last = (word.strip() for word in span.partition(".."))
    ends = (first or "0", last or "0")
    if not dots or not name.strip() or not all(map(is_count, ends)) or not (first or last):
        raise _option_error("--window", text, "m3=10..90, m3=10.. or m3=..90")
    if last and int(last) < int(ends[0]):
        raise _option_error("--window", text, "the earliest time first, as in m3=10..90")
    return name.strip(), (int(ends[0]), int(last) if last else None)


def _spelled_time(text: str) -> tuple[str, int]:
    name, _, value = (word.strip() for word in text.partition("="))
    if not name or not is_count(value):
        raise _option_error("--lasts", text, "m3=4")
    return name, int(value)


def _chain_pairs(text: str) -> list[tuple[str, str]]:
    names = [word.strip() for word in text.split(",")]
    if len(names) < 2 or not all(names) or len(set(names)) < len(names):
        raise _option_error("--before", text, "different visits in their order, as in m1,m2,m3")
    return list(pairwise(names))


def _option_error(option: str, text: str, example: str) -> InvalidInput:
    message = f"'{text}' cannot be read"
    return InvalidInput([Diagnostic(Source(option), "K406", message, f"write {example}")])


def require_known_visits(demands: TourDemands, names: set[str]) -> None:
    """Raise `InvalidInput` if an option names something that is no visit of the tour."""
    for option, named in (
        ("--window", demands.windows),
        ("--lasts", demands.lasts),
        ("--before", [name for pair in demands.before for name in pair]),
    ):
        for name in named:
            if name not in names:
                raise InvalidInput([unknown_name("visit", name, names, Source(option))])


def as_facts(problem: Problem, demands: TourDemands) -> Problem:
    """The problem with demands as static facts, in place of those that it has on the same
    measurements. Raises `InvalidInput`.

    So whoever plans, times or checks keeps them, and a plan file holds them.
    """
    words = problem.domain.conventions
    facts = [
        *(
            _demand_fact(words.window, name, first, last)
            for name, (first, last) in demands.windows.items()
        ),
        *(_demand_fact(words.lasts, name, duration) for name, duration in demands.lasts.items()),
        *(
            Function(words.before, (Function(first_name), Function(second_name)))
            for first_name, second_name in demands.before
        ),
    ]
    for name in dict.fromkeys(fact.name for fact in facts):
        if name not in problem.domain.predicates:
            hint = f"declare the static {name}, as bulkhead does"
            raise InvalidInput(
                [Diagnostic(Source(problem.path), "K405", f"the domain declares no '{name}'", hint)]
            )
    require_known_visits(demands, set(measurements_of(problem)))
    fact_subjects = {(fact.name, fact.arguments[0]) for fact in facts if fact.name != words.before}
    old = (
        fact
        for fact in problem.statics
        if not fact.arguments or (fact.name, fact.arguments[0]) not in fact_subjects
    )
    demanding = replace(problem, statics=tuple(dict.fromkeys((*old, *facts))))
    if wrong := demand_findings(demanding):
        raise InvalidInput(wrong)
    return demanding


def _demand_fact(predicate: str, name: str, *values: int | None) -> Function:
    """A fact that gives a measurement numbers; the greatest number stands for none."""
    return Function(
        predicate,
        (Function(name), *(Number(MAX_AMOUNT if value is None else value) for value in values)),
    )


def with_demands(tours: TourProblem, demands: TourDemands) -> TourProblem:
    """The tour with windows, durations and precedence.

    Demands on what is no visit of the tour are left out.
    """
    place = {visit.name: number for number, visit in enumerate(tours.visits)}
    pairs = [(place[a], place[b]) for a, b in demands.before if a in place and b in place]
    return replace(
        tours,
        visits=tuple(_demanding_visit(visit, demands) for visit in tours.visits),
        precedence=tuple(dict.fromkeys((*tours.precedence, *pairs))),
    )


def without_windows(tours: TourProblem) -> TourProblem:
    """The tour whose visits may begin at any time."""
    return replace(tours, visits=tuple(replace(visit, window=None) for visit in tours.visits))


def remaining_demands(demands: TourDemands, over: int, past: Collection[str]) -> TourDemands:
    """What is left of demands when so much time is over.

    Nothing is asked any more of the begin and the order of `past` visits.
    """
    windows = {
        name: (max(0, first - over), None if last is None else last - over)
        for name, (first, last) in demands.windows.items()
        if name not in past
    }
    before = tuple(pair for pair in demands.before if not {*pair} & {*past})
    return replace(demands, windows=windows, before=before)


def _demanding_visit(visit: Visit, demands: TourDemands) -> Visit:
    window = demands.windows.get(visit.name)
    if window is not None:
        first, last = window
        visit = replace(visit, window=(first, ENDLESS_WINDOW if last is None else last))
    return replace(visit, duration=demands.lasts.get(visit.name, visit.duration))
