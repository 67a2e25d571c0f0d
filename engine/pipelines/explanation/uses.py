"""What steps of a sequence are good for, when nothing but the sequence is known: which later step needs what a step brings."""

from collections.abc import Mapping, Sequence

from cellwright.engine.model.task import Task, indices
from cellwright.kb.terms import Atom, Function


def uses(
    task: Task, sequence: Sequence[Function], adds: Sequence[Sequence[Atom]], number: int
) -> list[tuple[Atom, Function | None]]:
    """What step `number` (from 0) of a sequence brings, each with the next step that needs it; None for what no later step needs.

    `adds` has what each step brings. A fact that another step brings again counts for that one.
    """
    needed = needs(task, sequence)
    found: list[tuple[Atom, Function | None]] = []
    for fact in adds[number]:
        consumer: Function | None = None
        for later in range(number + 1, len(sequence)):
            if fact in needed.get(sequence[later], frozenset()):
                consumer = sequence[later]
                break
            if fact in adds[later]:
                break
        found.append((fact, consumer))
    return found


def needs(task: Task, sequence: Sequence[Function]) -> Mapping[Function, frozenset[Atom]]:
    """The facts that each step needs."""
    wanted, found = set(sequence), dict[Function, set[Atom]]()
    for operator in task.operators:
        if operator.instance in wanted:
            own = {task.atoms[index] for index in indices(operator.preconditions)}
            found.setdefault(operator.instance, set()).update(own)
    return {step: frozenset(facts) for step, facts in found.items()}
