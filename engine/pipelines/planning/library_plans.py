"""Plans a problem with a MACROP library or without one, as the command line and Python ask it."""

from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from cellwright.engine.model.planning_choices import PlanningObjective, SequenceChoice
from cellwright.kb import store as kb_store

if TYPE_CHECKING:
    from collections.abc import Iterator

    from cellwright.engine.pipelines.planning.macros import LibraryPlanner
    from cellwright.engine.pipelines.planning.plan_objective import Run
    from cellwright.engine.stages.planning import SearchLimits
    from cellwright.kb.model.planning_problem import Problem


def plan_with_library(
    problem: "Problem",
    limits: "SearchLimits",
    objective_wanted: "PlanningObjective | None",
    order: "SequenceChoice",
    store: str,
    folded: bool,
    stays: bool = False,
) -> "tuple[Run, dict[str, Any]]":
    """The outcome for a problem, and when its steps happen. With a library, also where it comes
    from; with `folded`, also its parts, as data. The library `stays` open in a process that plans
    again and again."""
    from cellwright.engine.pipelines.planning import plan_objective

    if not store:
        return plan_objective.plan_for_objective(problem, limits, objective_wanted, order), {}
    if not (stays or folded) and _is_unpaid(store, problem):
        run, small = _planned_alone(problem, limits, objective_wanted, order)
        if small:
            return run, {
                "source": {
                    "origin": "planner",
                    "macrop": None,
                    "name": "",
                    "reason": kb_store.UNPAID,
                }
            }
    with _in_use(store, problem, limits, stays) as practice:
        if order is SequenceChoice.SEQUENCE:
            memory = practice.repertoire(problem.domain) if practice.learns else None
            followed = plan_objective.plan_sequence(problem, limits, memory, store)
            if followed is not None:
                return followed, {
                    "source": {"origin": "sequence", "macrop": None, "name": "", "reason": ""}
                }
        answer = practice.plan(problem)
        answer = practice.folded(problem, answer) if folded else answer
    entry = {
        "origin": answer.origin,
        "macrop": answer.macrop,
        "name": answer.name,
        "reason": answer.reason,
    }
    entry |= {"lost": practice.library.loss} if practice.library.loss else {}
    parts = [
        {
            "macrop": part.macrop,
            "name": part.name,
            "purpose": part.purpose,
            "steps": list(part.steps),
        }
        for part in answer.parts
    ]
    run = plan_objective.schedule_outcome(
        problem,
        answer.outcome,
        limits,
        PlanningObjective.COST if parts else objective_wanted,
    )
    return run, {"source": {**entry, "parts": parts} if parts else entry}


def _planned_alone(
    problem: "Problem",
    limits: "SearchLimits",
    wanted: "PlanningObjective | None",
    order: "SequenceChoice",
) -> "tuple[Run, bool]":
    """The run of a problem without a library, and whether the planner had so little to do that none
    could help.
    """
    from cellwright.engine.pipelines.planning import plan_objective
    from cellwright.engine.pipelines.planning.checked_plan import is_little_work

    run = plan_objective.plan_for_objective(problem, limits, wanted, order)
    return run, is_little_work(run.outcome)


def _is_unpaid(store: str, problem: "Problem") -> bool:
    """Whether lookups for such goals have not paid, as the file of a library tells before it is
    opened.
    """
    from cellwright.engine.model.part_measurements import is_put_in_order

    kinds = kb_store.unpaid_kinds(store, problem.domain.name)
    if not kinds or is_put_in_order(problem):
        return False
    from cellwright.engine.stages.grounding.grounding_program import ChangingPredicates
    from cellwright.engine.stages.grounding.initial_facts import initial_state
    from cellwright.engine.stages.lifted.cell_domain import CellDomain, Situation
    from cellwright.engine.stages.macros.lookup.macro_query import make_query, signature_asked

    state, wrong = initial_state(problem, ChangingPredicates(problem.domain))
    asked = make_query(problem, Situation.of(CellDomain(problem), state)) if not wrong else None
    return asked is not None and signature_asked(asked) in kinds


@contextmanager
def _in_use(
    store: str, problem: "Problem", limits: "SearchLimits", stays: bool
) -> "Iterator[LibraryPlanner]":
    if stays:
        from cellwright.engine.pipelines.planning.macros.library_planner import open_planner

        with open_planner(store, problem.domain, limits) as practice:
            yield practice
        return
    from cellwright.engine.pipelines.planning.macros import LibraryPlanner

    with (
        kb_store.Library(store, beside=True) as library,
        LibraryPlanner(library, limits) as practice,
    ):
        yield practice
