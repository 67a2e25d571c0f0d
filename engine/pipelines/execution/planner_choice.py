"""Choice of planners: which of the domain's tools make the first plan, and in which order.

A tool needs products and gives one. A domain declares its tools (`tools`), the preferred ones
first. What is wanted is a timetable; backward from there, of the tools that give a product the
first one is used that serves, after others have made what it needs. So a cell of another kind needs
no code: it names other tools, or puts them in another order.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field

from cellwright.engine.model.ground_task import GroundTask
from cellwright.engine.model.outcome import Found, GaveUp, Outcome
from cellwright.engine.pipelines.planning import plan_objective
from cellwright.engine.pipelines.planning.checked_plan import plan_and_ground
from cellwright.engine.pipelines.planning.macros import LibraryPlanner
from cellwright.engine.stages.planning import SearchLimits
from cellwright.kb.model.plan_model import StepId
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.store import Library

PLAN, TIMETABLE = "a plan", "a timetable"
MAX_NAME_LETTERS = 40  # letters of the name of a MACROP that are told whole


@dataclass
class PlannerWork:
    """What is asked, and what the tools have made of it so far; `notes` say how."""

    problem: Problem
    limits: SearchLimits
    store: str = ""
    outcome: Outcome | None = None
    task: GroundTask | None = None
    starts: Mapping[StepId, int] | None = None
    products: set[str] = field(default_factory=set)
    notes: list[str] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class PlanningTool:
    """A tool of the top level.

    `use` says whether it serves here, and if it does, adds what it gives to the work.
    """

    needs: tuple[str, ...]
    gives: tuple[str, ...]
    use: Callable[[PlannerWork], bool]


@dataclass(frozen=True)
class PlannerResult:
    """The outcome, the starts of the steps if they take time, and which tools made it."""

    outcome: Outcome
    starts: Mapping[StepId, int] | None
    notes: tuple[str, ...]


def choose_and_plan(
    problem: Problem, limits: SearchLimits, store: str = "", outcome: Outcome | None = None
) -> PlannerResult:
    """What the tools of the domain make of a problem.

    `outcome` is a plan that is known already. Raises `InvalidInput`.
    """
    work = PlannerWork(problem, limits, store, outcome)
    if outcome is not None:
        work.products.add(PLAN)
    if not _achieve_product(TIMETABLE, work, frozenset()) and work.outcome is None:
        _achieve_product(PLAN, work, frozenset())
    if work.outcome is None:
        tools = ", ".join(problem.domain.tools)
        return PlannerResult(GaveUp(f"no tool of the domain makes a plan: {tools}"), None, ())
    return PlannerResult(work.outcome, work.starts, tuple(work.notes))


def _achieve_product(product: str, work: PlannerWork, wanted: frozenset[str]) -> bool:
    """Have a product made by the first tool that serves; `wanted` are those on whose behalf it
    is wanted.
    """
    if product in work.products:
        return True
    for name, tool in _tools_giving(product, work):
        if wanted & set(tool.needs):
            continue
        if all(
            _achieve_product(need, work, wanted | {product}) for need in tool.needs
        ) and tool.use(work):
            work.products.update(tool.gives)
            work.notes.append(f"{name}: {' and '.join(tool.gives)}")
            return True
        if work.outcome is not None and not isinstance(work.outcome, Found):
            return False  # there is no plan, and this is known
    return False


def _tools_giving(product: str, work: PlannerWork) -> Iterator[tuple[str, PlanningTool]]:
    """The declared tools that give a product, in the order of the declaration."""
    for name in work.problem.domain.tools:
        if name in PLANNING_TOOLS and product in PLANNING_TOOLS[name].gives:
            yield name, PLANNING_TOOLS[name]


def _use_sequencer(work: PlannerWork) -> bool:
    """Measurements in the order of their tour, with the times of the plan that follows it."""
    tour = plan_objective.plan_sequence(work.problem, work.limits)
    if tour is None:
        return False
    work.outcome, work.starts = tour.outcome, tour.starts
    return isinstance(tour.outcome, Found)


def _use_library(work: PlannerWork) -> bool:
    """A plan from the library, or from the planner for the library, which learns from it."""
    if not work.store:
        return False
    with Library(work.store) as library, LibraryPlanner(library, work.limits) as practice:
        answer = practice.plan(work.problem)
    work.outcome = answer.outcome
    if answer.origin != "planner":
        named = (
            answer.name
            if len(answer.name) <= MAX_NAME_LETTERS
            else f"{answer.name.partition('(')[0]}(...)"
        )
        work.notes.append(f"from {answer.origin}{f': {named}' if named else ''}")
    return isinstance(answer.outcome, Found)


def _use_planner(work: PlannerWork) -> bool:
    work.outcome, work.task = plan_and_ground(work.problem, work.limits)
    return isinstance(work.outcome, Found)


def _use_scheduler(work: PlannerWork) -> bool:
    assert work.outcome is not None
    timetable = plan_objective.schedule_outcome(
        work.problem, work.outcome, work.limits, None, work.task
    )
    work.outcome, work.starts = timetable.outcome, timetable.starts
    return True


PLANNING_TOOLS: Mapping[str, PlanningTool] = {
    "sequencer": PlanningTool((), (PLAN, TIMETABLE), _use_sequencer),
    "library": PlanningTool((), (PLAN,), _use_library),
    "planner": PlanningTool((), (PLAN,), _use_planner),
    "scheduler": PlanningTool((PLAN,), (TIMETABLE,), _use_scheduler),
}
