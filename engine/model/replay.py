"""Steps of a plan as ground operators that reach every stage of the workflow as early as possible.

Searches reach stages that are fluents by internal operators, where they please. To reach a stage early is never worse, so
here each internal operator stands just behind the step that makes it possible, or is joined with it.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

from cellwright.engine.model.stages import ENDS, MEETS, REACHES, STAGE
from cellwright.engine.model.task import Bits, GroundOperator, Task, bitset, progress
from cellwright.kb.terms import Function

Instances = Mapping[Function, list[GroundOperator]]


def instances(task: Task) -> Instances:
    """The ground operators of each instance. They differ in supports and in the stages that they reach."""
    found: dict[Function, list[GroundOperator]] = {}
    for operator in task.operators:
        found.setdefault(operator.instance, []).append(operator)
    return found


def reaching_operators(task: Task) -> list[GroundOperator]:
    """The internal operators that reach stages where a fluent holds."""
    return [operator for operator in task.operators if operator.instance.name == REACHES]


def settling(state: Bits, reaching: Sequence[GroundOperator]) -> Iterator[GroundOperator]:
    """The internal operators that are taken at once in a state, one after another."""
    while ready := [each for each in reaching if not each.preconditions & ~state]:
        for each in ready:
            if not each.preconditions & ~state:
                yield each
                state = progress(state, each)


def settled(task: Task, state: Bits) -> Bits:
    """A state in which every stage that may be reached, and holds, is reached."""
    for each in settling(state, reaching_operators(task)):
        state = progress(state, each)
    return state


def _possible(task: Task, step: GroundOperator, state: Bits) -> GroundOperator:
    """The step, or an operator with the same instance and effects whose conditions hold where those of the step do not.

    The other one may differ in the stages that it reaches: in another order of the steps an earlier one may have reached them.
    """
    if not step.preconditions & ~state:
        return step
    others = [o for o in task.operators if o.instance == step.instance and not o.preconditions & ~state]
    alike = [each for each in others if (each.adds, each.deletes) == (step.adds, step.deletes)]
    besides = ~_stages(task)
    alike += [o for o in others if not (o.adds ^ step.adds | o.deletes ^ step.deletes) & besides]
    return next(iter(alike), step)


def _stages(task: Task) -> Bits:
    return bitset([number for number, atom in enumerate(task.atoms) if atom.name == STAGE])


def early(task: Task, steps: Sequence[GroundOperator]) -> list[GroundOperator]:
    """The same steps with every stage reached as early as possible; as they are if that bars a step or a goal."""
    reaching = reaching_operators(task)
    if not reaching:
        return list(steps)
    state, made = task.initial, list[GroundOperator]()
    for each in steps:
        if each.instance.name == REACHES:
            continue
        step = _possible(task, each, state)
        if step.preconditions & ~state:
            return list(steps)
        state = task.after(state, step)
        made.append(step)
        for each in settling(state, reaching):
            state = task.after(state, each)
            made.append(each)
    return made if reached_goals(task, state) is not None else list(steps)


def joined(task: Task, steps: Sequence[GroundOperator], goals: Bits) -> tuple[list[GroundOperator], Bits]:
    """The steps, each with the stages that it reaches, and what must hold at the end for the goals.

    A stage that held before its step reached it, that still holds at the end, and that nothing waits for, is left to the
    end: nothing need be ordered for it.
    """
    stages = _stages(task)
    steps = early(task, steps)
    late, goals = _late(task, steps, goals, stages)
    made: list[GroundOperator] = []
    before = state = task.initial
    for place, step in enumerate(steps):
        if step.instance.name != REACHES:
            made.append(step)
            before = state
        elif made and place not in late:
            made[-1] = _with(made[-1], step, before)
        state = progress(state, step)
    return made, goals


def _late(
    task: Task, steps: Sequence[GroundOperator], goals: Bits, stages: Bits
) -> tuple[frozenset[int], Bits]:
    """The places of internal operators that may wait for the end, and what then must hold there."""
    final = task.initial
    for step in steps:
        final = progress(final, step)
    needed, late, trigger = 0, list[int](), 0
    triggers = []
    for place, step in enumerate(steps):
        trigger = trigger if step.instance.name == REACHES else place
        triggers.append(trigger)
    for place in reversed(range(len(steps))):
        step = steps[place]
        held = step.preconditions & ~step.deletes
        new = held & steps[triggers[place]].adds & ~stages
        if step.instance.name == REACHES and not (step.adds & needed or held & ~final or new):
            late.append(place)
            goals = goals & ~step.adds | step.preconditions
        else:
            needed |= step.preconditions
            if step.instance.name == REACHES and step.deletes & goals:  # left to the end in another order
                goals = goals & ~step.deletes | step.adds
    return frozenset(late), goals


def _with(step: GroundOperator, reaching: GroundOperator, before: Bits) -> GroundOperator:
    """A step that reaches one more stage; what held `before` it and it does not add, it needs."""
    held = reaching.preconditions & before & ~step.adds
    return replace(
        step,
        preconditions=step.preconditions | held,
        adds=step.adds & ~reaching.deletes | reaching.adds,
        deletes=step.deletes | reaching.deletes,
    )


def replayed(
    task: Task, known: Instances, state: Bits, steps: Iterable[Function]
) -> list[GroundOperator] | None:
    """The operators of the task for instances that are applied one after another from a state, with the internal ones that
    reach stages between them; None if an instance cannot be applied.

    If several ground operators fit an instance, the one that reaches most stages is taken.
    """
    reaching, found = reaching_operators(task), list[GroundOperator]()
    for instance in steps:
        fitting = [each for each in known.get(instance, ()) if not each.preconditions & ~state]
        if not fitting:
            return None
        best = max(fitting, key=lambda each: (each.adds & ~state).bit_count())
        found.append(best)
        state = task.after(state, best)
        for each in settling(state, reaching):
            found.append(each)
            state = task.after(state, each)
    return found


def reached_goals(task: Task, state: Bits) -> Bits | None:
    """The alternative of the goals that holds in a closed state, with fluents from which its derived atoms follow."""
    found = next((goal for goal in task.goals if not goal & ~state), None)
    return found if found is None or task.axioms is None else task.axioms.support(state, found)


def reached_at_the_end(task: Task, state: Bits) -> Bits | None:
    """As `reached_goals`, if the plan ended here: of atoms that only internal operators add at its end, it has what these need."""
    added: dict[Bits, Bits] = {each.adds: 0 for each in task.operators if each.instance.name == ENDS}
    ended = sum(added)
    for each in task.operators:
        if each.instance.name == MEETS and not (needed := each.preconditions & ~ended) & ~state:
            added.setdefault(each.adds, needed)
    whole = state
    for atoms in added:
        whole |= atoms
    found = reached_goals(replace(task, axioms=None), whole)
    for atoms, needed in added.items():
        if found is not None and found & atoms:
            found = found & ~atoms | needed
    return found if found is None or task.axioms is None else task.axioms.support(state, found)
