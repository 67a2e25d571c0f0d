"""What a tour has to keep beside its visits: windows of time, durations, and which visit comes before which.

A problem gives them as facts, the command line as options; both are counted together.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from graphlib import CycleError, TopologicalSorter
from itertools import pairwise

from cellwright.engine.model.measurements import measurements_of
from cellwright.engine.model.tour import ENDLESS, TourProblem, Visit
from cellwright.kb.asp.statics import evaluated
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, unknown_name
from cellwright.kb.model.amounts import LARGEST, Facts
from cellwright.kb.model.conventions import Conventions
from cellwright.kb.model.problem import Problem
from cellwright.kb.numbers import is_count
from cellwright.kb.terms import Function, Number, Term

Window = tuple[int, int | None]


@dataclass(frozen=True, slots=True)
class Demands:
    """Windows (earliest and latest beginning, None if any), durations and pairs (first, second), by names of visits."""

    windows: Mapping[str, Window] = field(default_factory=dict)
    lasts: Mapping[str, int] = field(default_factory=dict)
    before: tuple[tuple[str, str], ...] = ()

    def and_also(self, others: "Demands") -> "Demands":
        """All demands of both; where both speak of the same visit, those of `others`."""
        return Demands(
            {**self.windows, **others.windows},
            {**self.lasts, **others.lasts},
            tuple(dict.fromkeys((*self.before, *others.before))),
        )

    @property
    def need_times(self) -> bool:
        """Whether costs must be times."""
        return bool(self.windows) or bool(self.lasts)


def of_facts(facts: Facts, words: Conventions, where: Source) -> Demands:
    """The demands of the static facts of a problem. Raises `InvalidInput` if a measurement has two windows or durations."""
    windows = _only(words.window, facts(words.window, 3), where)
    lasts = _only(words.lasts, facts(words.lasts, 2), where)
    pairs = sorted((str(first), str(second)) for first, second in facts(words.before, 2))
    return Demands(
        {name: (each[0], each[1]) for name, each in windows.items()},
        {name: each[0] for name, each in lasts.items()},
        tuple(pairs),
    )


def _only(predicate: str, facts: Iterable[tuple[Term, ...]], where: Source) -> dict[str, tuple[int, ...]]:
    """The numbers that a predicate gives to each name."""
    found: dict[str, tuple[int, ...]] = {}
    for name, *values in facts:
        numbers = _numbers(predicate, name, values, where)
        if found.setdefault(str(name), numbers) != numbers:
            said = f"{name} has two values of {predicate}: {_list(found[str(name)])} and {_list(numbers)}"
            raise InvalidInput([Diagnostic(where, "K115", said, "keep one of them")])
    return found


def _numbers(predicate: str, name: Term, values: Sequence[Term], where: Source) -> tuple[int, ...]:
    numbers = tuple(each.value for each in values if isinstance(each, Number))
    if len(numbers) == len(values) and min(numbers) >= 0 and list(numbers) == sorted(numbers):
        return numbers
    said = f"{predicate} of {name} is {_list(values)}"
    hint = "write times of 0 or more; a window has the earliest and then the latest"
    raise InvalidInput([Diagnostic(where, "K115", said, hint)])


def _list(values: Sequence[object]) -> str:
    return ", ".join(map(str, values))


def findings_of(problem: Problem) -> list[Diagnostic]:
    """What is wrong with the windows, durations and precedence that the facts of a problem demand of its tours."""
    words, where = problem.domain.conventions, Source(problem.path)
    if not {words.window, words.lasts, words.before} & set(problem.domain.predicates):
        return []
    grounder = evaluated(problem)
    try:
        demands = of_facts(grounder.atoms, words, where)
    except InvalidInput as error:
        return list(error.diagnostics)
    circle = _circle(demands.before)
    if not circle:
        return []
    said = f"{words.before} forms a cycle: {' before '.join(circle)}"
    return [Diagnostic(where, "K115", said, "remove one of these facts")]


def _circle(pairs: Sequence[tuple[str, str]]) -> list[str]:
    """Names of which each comes before the next, and the last is the first; empty if there are none."""
    earlier: dict[str, list[str]] = {}
    for first, second in pairs:
        earlier.setdefault(second, []).append(first)
    try:
        TopologicalSorter(earlier).prepare()
    except CycleError as error:
        return [str(name) for name in error.args[1]]
    return []


def of_options(windows: Sequence[str], lasts: Sequence[str], before: Sequence[str]) -> Demands:
    """The demands that options spell: `m3=10..90`, `m3=4` and `m1,m2,m3`. Raises `InvalidInput`."""
    return Demands(
        dict(_spelled_window(each) for text in windows for each in text.split(",")),
        dict(_spelled_time(each) for text in lasts for each in text.split(",")),
        tuple(pair for text in before for pair in _chain(text)),
    )


def _spelled_window(text: str) -> tuple[str, Window]:
    name, _, span = text.partition("=")
    first, dots, last = (each.strip() for each in span.partition(".."))
    ends = (first or "0", last or "0")
    if not dots or not name.strip() or not all(map(is_count, ends)) or not (first or last):
        raise _wrong("--window", text, "m3=10..90, m3=10.. or m3=..90")
    if last and int(last) < int(ends[0]):
        raise _wrong("--window", text, "the earliest time first, as in m3=10..90")
    return name.strip(), (int(ends[0]), int(last) if last else None)


def _spelled_time(text: str) -> tuple[str, int]:
    name, _, value = (each.strip() for each in text.partition("="))
    if not name or not is_count(value):
        raise _wrong("--lasts", text, "m3=4")
    return name, int(value)


def _chain(text: str) -> list[tuple[str, str]]:
    names = [each.strip() for each in text.split(",")]
    if len(names) < 2 or not all(names) or len(set(names)) < len(names):
        raise _wrong("--before", text, "different visits in their order, as in m1,m2,m3")
    return list(pairwise(names))


def _wrong(option: str, text: str, example: str) -> InvalidInput:
    said = f"'{text}' cannot be read"
    return InvalidInput([Diagnostic(Source(option), "K406", said, f"write {example}")])


def known(demands: Demands, names: set[str]) -> None:
    """Raise `InvalidInput` if an option names something that is no visit of the tour."""
    for option, given in (
        ("--window", demands.windows),
        ("--lasts", demands.lasts),
        ("--before", [name for pair in demands.before for name in pair]),
    ):
        for name in given:
            if name not in names:
                raise InvalidInput([unknown_name("visit", name, names, Source(option))])


def as_facts(problem: Problem, demands: Demands) -> Problem:
    """The problem with demands as static facts, in place of those that it has on the same measurements. Raises `InvalidInput`.

    So whoever plans, times or checks keeps them, and a plan file holds them.
    """
    words = problem.domain.conventions
    facts = [
        *(_fact(words.window, name, first, last) for name, (first, last) in demands.windows.items()),
        *(_fact(words.lasts, name, each) for name, each in demands.lasts.items()),
        *(Function(words.before, (Function(one), Function(other))) for one, other in demands.before),
    ]
    for name in dict.fromkeys(fact.name for fact in facts):
        if name not in problem.domain.predicates:
            hint = f"declare the static {name}, as bulkhead does"
            raise InvalidInput(
                [Diagnostic(Source(problem.path), "K405", f"the domain declares no '{name}'", hint)]
            )
    known(demands, set(measurements_of(problem)))
    told = {(fact.name, fact.arguments[0]) for fact in facts if fact.name != words.before}
    old = (
        fact for fact in problem.statics if not fact.arguments or (fact.name, fact.arguments[0]) not in told
    )
    found = replace(problem, statics=tuple(dict.fromkeys((*old, *facts))))
    if wrong := findings_of(found):
        raise InvalidInput(wrong)
    return found


def _fact(predicate: str, name: str, *values: int | None) -> Function:
    """A fact that gives a measurement numbers; the greatest number stands for none."""
    return Function(
        predicate, (Function(name), *(Number(LARGEST if value is None else value) for value in values))
    )


def with_demands(tours: TourProblem, demands: Demands) -> TourProblem:
    """The tour with windows, durations and precedence. Demands on what is no visit of the tour are left out."""
    place = {visit.name: number for number, visit in enumerate(tours.visits)}
    pairs = [(place[a], place[b]) for a, b in demands.before if a in place and b in place]
    return replace(
        tours,
        visits=tuple(_visit(each, demands) for each in tours.visits),
        precedence=tuple(dict.fromkeys((*tours.precedence, *pairs))),
    )


def without_windows(tours: TourProblem) -> TourProblem:
    """The tour whose visits may begin at any time."""
    return replace(tours, visits=tuple(replace(visit, window=None) for visit in tours.visits))


def later(demands: Demands, over: int, past: Collection[str]) -> Demands:
    """What is left of demands when so much time is over. Nothing is asked any more of the begin and the order of `past` visits."""
    windows = {
        name: (max(0, first - over), None if last is None else last - over)
        for name, (first, last) in demands.windows.items()
        if name not in past
    }
    before = tuple(pair for pair in demands.before if not {*pair} & {*past})
    return replace(demands, windows=windows, before=before)


def _visit(visit: Visit, demands: Demands) -> Visit:
    window = demands.windows.get(visit.name)
    if window is not None:
        first, last = window
        visit = replace(visit, window=(first, ENDLESS if last is None else last))
    return replace(visit, duration=demands.lasts.get(visit.name, visit.duration))
