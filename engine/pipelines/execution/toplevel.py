"""The top level of a run as a planner over tools: which ones are used for the first plan, and in which order.

A tool needs products and gives one. A domain declares its tools (`tools`), the preferred ones first. What is wanted is a
timetable; backward from there, of the tools that give a product the first one is used that serves, after others have made what
it needs. So a cell of another kind needs no code: it names other tools, or puts them in another order.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field

from cellwright.engine.model.outcome import Found, GaveUp, Outcome
from cellwright.engine.model.task import Task
from cellwright.engine.pipelines import objective
from cellwright.engine.pipelines.planning import planned
from cellwright.engine.pipelines.reuse import Practice
from cellwright.engine.stages.planning import Limits
from cellwright.kb.model.plan import StepId
from cellwright.kb.model.problem import Problem
from cellwright.kb.store import Library

PLAN, TIMETABLE = "a plan", "a timetable"
SHORT = 40  # letters of the name of a MACROP that are told whole


@dataclass
class Work:
    """What is asked, and what the tools have made of it so far; `notes` say how."""

    problem: Problem
    limits: Limits
    store: str = ""
    outcome: Outcome | None = None
    task: Task | None = None
    starts: Mapping[StepId, int] | None = None
    products: set[str] = field(default_factory=set)
    notes: list[str] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class Tool:
    """A tool of the top level. `use` says whether it serves here, and if it does, adds what it gives to the work."""

    needs: tuple[str, ...]
    gives: tuple[str, ...]
    use: Callable[[Work], bool]


@dataclass(frozen=True)
class Made:
    """The outcome, the starts of the steps if they take time, and which tools made it."""

    outcome: Outcome
    starts: Mapping[StepId, int] | None
    notes: tuple[str, ...]


def made(problem: Problem, limits: Limits, store: str = "", outcome: Outcome | None = None) -> Made:
    """What the tools of the domain make of a problem. `outcome` is a plan that is known already. Raises `InvalidInput`."""
    work = Work(problem, limits, store, outcome)
    if outcome is not None:
        work.products.add(PLAN)
    if not _achieve(TIMETABLE, work, frozenset()) and work.outcome is None:
        _achieve(PLAN, work, frozenset())
    if work.outcome is None:
        tools = ", ".join(problem.domain.tools)
        return Made(GaveUp(f"no tool of the domain makes a plan: {tools}"), None, ())
    return Made(work.outcome, work.starts, tuple(work.notes))


def _achieve(product: str, work: Work, wanted: frozenset[str]) -> bool:
    """Have a product made by the first tool that serves; `wanted` are those on whose behalf it is wanted."""
    if product in work.products:
        return True
    for name, tool in _giving(product, work):
        if wanted & set(tool.needs):
            continue
        if all(_achieve(each, work, wanted | {product}) for each in tool.needs) and tool.use(work):
            work.products.update(tool.gives)
            work.notes.append(f"{name}: {' and '.join(tool.gives)}")
            return True
        if work.outcome is not None and not isinstance(work.outcome, Found):
            return False  # there is no plan, and this is known
    return False


def _giving(product: str, work: Work) -> Iterator[tuple[str, Tool]]:
    """The declared tools that give a product, in the order of the declaration."""
    for name in work.problem.domain.tools:
        if name in TOOLS and product in TOOLS[name].gives:
            yield name, TOOLS[name]


def _sequence(work: Work) -> bool:
    """Measurements in the order of their tour, with the times of the plan that follows it."""
    found = objective.sequenced(work.problem, work.limits)
    if found is None:
        return False
    work.outcome, work.starts = found.outcome, found.starts
    return isinstance(found.outcome, Found)


def _look_up(work: Work) -> bool:
    """A plan from the library, or from the planner for the library, which learns from it."""
    if not work.store:
        return False
    with Library(work.store) as library, Practice(library, work.limits) as practice:
        found = practice.plan(work.problem)
    work.outcome = found.outcome
    if found.origin != "planner":
        named = found.name if len(found.name) <= SHORT else f"{found.name.partition('(')[0]}(...)"
        work.notes.append(f"from {found.origin}{f': {named}' if named else ''}")
    return isinstance(found.outcome, Found)


def _plan(work: Work) -> bool:
    work.outcome, work.task = planned(work.problem, work.limits)
    return isinstance(work.outcome, Found)


def _schedule(work: Work) -> bool:
    assert work.outcome is not None
    found = objective.scheduled(work.problem, work.outcome, work.limits, None, work.task)
    work.outcome, work.starts = found.outcome, found.starts
    return True


TOOLS: Mapping[str, Tool] = {
    "sequencer": Tool((), (PLAN, TIMETABLE), _sequence),
    "library": Tool((), (PLAN,), _look_up),
    "planner": Tool((), (PLAN,), _plan),
    "scheduler": Tool((PLAN,), (TIMETABLE,), _schedule),
}
