"""Plans made with a library of MACROPs, or without one: what is known already is used, and what is new is learned."""

from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterator

    from cellwright.engine.pipelines.objective import Objective, Order, Run
    from cellwright.engine.pipelines.reuse import Practice
    from cellwright.engine.stages.planning import Limits
    from cellwright.kb.model.problem import Problem


def planned(
    problem: "Problem",
    limits: "Limits",
    wanted: "Objective | None",
    order: "Order",
    store: str,
    folded: bool,
    stays: bool = False,
) -> "tuple[Run, dict[str, Any]]":
    """The outcome for a problem, and when its steps happen. With a library, also where it comes from; with `folded`, also
    its parts, as data. The library `stays` open in a process that plans again and again."""
    from cellwright.engine.pipelines import objective

    if not store:
        return objective.plan(problem, limits, wanted, order), {}
    with _in_use(store, problem, limits, stays) as practice:
        if order is objective.Order.SEQUENCE:
            memory = practice.repertoire(problem.domain) if practice.learns else None
            followed = objective.sequenced(problem, limits, memory, store)
            if followed is not None:
                return followed, {"source": {"origin": "sequence", "macrop": None, "name": "", "reason": ""}}
        found = practice.plan(problem)
        found = practice.folded(problem, found) if folded else found
    entry = {"origin": found.origin, "macrop": found.macrop, "name": found.name, "reason": found.reason}
    entry |= {"lost": practice.library.loss} if practice.library.loss else {}
    parts = [
        {"macrop": part.macrop, "name": part.name, "purpose": part.purpose, "steps": list(part.steps)}
        for part in found.parts
    ]
    run = objective.scheduled(problem, found.outcome, limits, objective.Objective.COST if parts else wanted)
    return run, {"source": {**entry, "parts": parts} if parts else entry}


@contextmanager
def _in_use(store: str, problem: "Problem", limits: "Limits", stays: bool) -> "Iterator[Practice]":
    if stays:
        from cellwright.engine.pipelines.reuse.standing import standing

        with standing(store, problem.domain, limits) as practice:
            yield practice
        return
    from cellwright.engine.pipelines.reuse import Practice
    from cellwright.kb.store import Library

    with Library(store, beside=True) as library, Practice(library, limits) as practice:
        yield practice
