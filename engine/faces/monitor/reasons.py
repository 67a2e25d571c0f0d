"""Answers that take a while, found in a process of their own: why a step is in a plan, and the decision tree of an exception."""

from collections.abc import Collection, Sequence
from functools import lru_cache
from typing import Any

from cellwright.engine.faces.monitor.motions import Target
from cellwright.engine.model.task import Task
from cellwright.engine.pipelines.execution.records import read_atom
from cellwright.engine.pipelines.explanation.uses import uses
from cellwright.kb.diagnostics import InvalidInput

TASKS = 4  # that are kept


@lru_cache(TASKS)
def _task(target: Target) -> Task:
    from cellwright.engine.pipelines.planning import problem_of
    from cellwright.engine.stages.grounding import ground

    return ground(problem_of(*target))


def reasons(target: Target, steps: Sequence[dict[str, Any]], number: int) -> list[str]:
    """What a step (by its id) of a plan is good for; `steps` are those of the plan in its order, as a record has them."""
    place = [each["id"] for each in steps].index(number)
    try:
        task = _task(target)
    except InvalidInput as refused:
        return [refused.diagnostics[0].message]
    sequence = [read_atom(each["step"]) for each in steps]
    adds = [list(map(read_atom, each.get("adds", ()))) for each in steps]
    events = [*adds[place], *map(read_atom, steps[place].get("events", ()))]
    adds[place] = events
    return [
        f"brings {fact}" + (f", which {consumer} needs" if consumer is not None else "")
        for fact, consumer in uses(task, sequence, adds, place)
    ]


def decision_tree(target: str, exception: str, step: str) -> str:
    """The decision tree of an exception at a step as SVG; a sentence if there is none."""
    from cellwright.engine.formats.report.decision_svg import decision_tree as drawn
    from cellwright.engine.model.troubleshooting import expected_cost
    from cellwright.engine.pipelines.troubleshooting import desk

    try:
        found = desk(target, exception, step)
    except InvalidInput as refused:
        return refused.diagnostics[0].message
    made = found.session.selector.tree(found.session.standing)
    return drawn(found.session.case.problem, made, expected_cost(made))


def contact_states(target: str, facts: Collection[str]) -> tuple[str, list[tuple[str, ...]]]:
    """The net of the cell's contact states as SVG, marked as facts tell, and for each object: its place, and who else is there.

    A sentence and nothing if the cell has no contact model.
    """
    from cellwright.engine.formats.report.states_svg import net as drawn
    from cellwright.engine.pipelines.task_space.marking import marking, player_of

    try:
        player = player_of(target)
    except InvalidInput as refused:
        return refused.diagnostics[0].message, []
    marked = marking(player, facts)
    rows = [
        (name, place, ", ".join(each for each in inside if each != name))
        for place, clusters in marked.items()
        for inside in clusters
        for name in inside
    ]  # fmt: skip
    return drawn(player.net, marked), sorted(rows)
