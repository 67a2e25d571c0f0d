"""The facts that stand in the way of the goals, with the thing that cannot be used because of them.

"slra (laser) is not available: location(slra, t3_746, elsewhere) holds at the start, and no step
that can be taken ends that". A fact stands in the way if there is a plan without it.
"""

from collections.abc import Iterator, Sequence

from cellwright.engine.model.ground_task import GroundTask
from cellwright.engine.model.plan_explanation import Amendment, Edit
from cellwright.engine.pipelines.explanation.amendments import INITIAL, OBJECT
from cellwright.kb.model.domain_model import Domain
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Atom, Function


def obstacle_reasons(
    problem: Problem, task: GroundTask, changes: Sequence[Amendment]
) -> Iterator[str]:
    """A text for each change that does no more than to remove a fact."""
    for change in changes:
        if len(change.edits) == 1 and (fact := obstacle_of(change.edits[0])) is not None:
            held = f"the problem says {fact}"
            if change.edits[0].layer == INITIAL:
                lasts = not _is_changed(task, fact)
                held = f"{fact} holds at the start{', and no step that can be taken ends that' if lasts else ''}"
            thing = barred_thing(problem, fact)
            if thing is None or str(thing) not in (change.missing or ("",))[-1]:
                yield held
            else:
                type_ = _object_type(problem, thing)
                yield f"{thing} ({type_}) is not available: {held}"


def obstacle_of(edit: Edit) -> Atom | None:
    """The fact that an edit removes, if it does nothing else and is about no object alone."""
    return edit.removed if edit.added is None and edit.layer != OBJECT else None


def barred_thing(problem: Problem, fact: Atom) -> Function | None:
    """The thing that a fact is about: its first argument, if that is an object and no value of a
    closed list.
    """
    first = fact.arguments[0] if fact.arguments else None
    if not isinstance(first, Function) or first.arguments or not _object_type(problem, first):
        return None
    return None if first.name in _constants(problem.domain) else first


def _object_type(problem: Problem, thing: Function) -> str:
    return {**problem.domain.objects, **problem.objects}.get(thing.name, "")


def _constants(domain: Domain) -> frozenset[str]:
    return frozenset(name for type_ in domain.types.values() for name in type_.constants)


def _is_changed(task: GroundTask, fact: Atom) -> bool:
    """Whether a step that can be reached makes a fact false."""
    if fact not in task.atoms:
        return False
    bit = 1 << list(task.atoms).index(fact)
    return any(
        bit & deletes
        for operator in task.operators
        for deletes in (operator.deletes, *(part.deletes for part in operator.conditional))
    )
