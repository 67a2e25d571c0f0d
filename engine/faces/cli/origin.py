"""Plans made with or without a library of MACROPs, and the text about where they come from."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rich.console import RenderableType

    from engine.pipelines.objective import Objective, Order, Run
    from engine.stages.planning import Limits
    from kb.diagnostics import Diagnostic
    from kb.model.problem import Problem


def planned(
    problem: "Problem",
    limits: "Limits",
    wanted: "Objective | None",
    order: "Order",
    store: str,
    folded: bool,
) -> "tuple[Run, dict[str, Any]]":
    """The outcome for a problem, and when its steps happen. With a library, also where it comes from; with `folded`, also
    its parts, as data."""
    from engine.pipelines import objective

    if not store:
        return objective.plan(problem, limits, wanted, order), {}
    from engine.pipelines.reuse import Practice
    from kb.store import Library

    with Library(store, beside=True) as library, Practice(library, limits) as practice:
        if order is objective.Order.SEQUENCE:
            memory = practice.repertoire(problem.domain) if practice.learns else None
            followed = objective.sequenced(problem, limits, memory, store)
            if followed is not None:
                return followed, {"source": {"origin": "sequence", "macrop": None, "name": "", "reason": ""}}
        found = practice.plan(problem)
        found = practice.folded(problem, found) if folded else found
    entry = {"origin": found.origin, "macrop": found.macrop, "name": found.name, "reason": found.reason}
    entry |= {"lost": library.loss} if library.loss else {}
    parts = [
        {"macrop": part.macrop, "name": part.name, "purpose": part.purpose, "steps": list(part.steps)}
        for part in found.parts
    ]
    run = objective.scheduled(problem, found.outcome, limits, objective.Objective.COST if parts else wanted)
    return run, {"source": {**entry, "parts": parts} if parts else entry}


def losses(content: "Mapping[str, Any]", store: str) -> "tuple[Diagnostic, ...]":
    """A warning if the library could not keep what was learned. The plan is no worse for it."""
    from kb.diagnostics import Diagnostic, Source

    said = content.get("source", {}).get("lost")
    message, hint = f"nothing was kept: {said}", "make room on the disk, or name another library"
    return (Diagnostic(Source(store), "K416", message, hint, warning=True),) if said else ()


def origin_text(content: "Mapping[str, Any]") -> "list[RenderableType]":
    """A line about where a plan comes from, if a library was used, and the parts of the plan."""
    found = content.get("source")
    if not found:
        return []
    from engine.formats.report.macros import folded, origin

    parts = folded(found.get("parts", ()))
    said = origin(found["origin"], found["macrop"], found["name"], found["reason"], listed=parts is not None)
    return [each for each in (parts, said) if each]
