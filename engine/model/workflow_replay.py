"""Workflow stages in ground plans: their fluents, and replays that reach stages early.

Searches reach stages that are fluents by internal operators, where they please. To reach a stage
early is never worse, so here each internal operator stands just behind the step that makes it
possible, or is joined with it.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

from cellwright.engine.kernels.bits import Bits, bitset
from cellwright.engine.model.ground_task import GroundOperator, GroundTask, progress_state
from cellwright.kb.model.planning_problem import Chain
from cellwright.kb.terms import Atom, Function, Number, Text

STAGE_FLUENT = "_stage"
STAGE_OPERATOR = "_reaches"
# Internal operators: one ends a plan, the others say then how a goal holds.
ENDS, MEETS = "_ends", "_meets"


def stage_atom(chain: Chain, reached: int) -> Atom:
    """The fluent that says how many stages of a chain are reached."""
    return Function(STAGE_FLUENT, (Text(chain.name), Number(reached)))


def stage_operator(chain: Chain, count: int) -> Function:
    """The internal operator that moves a chain to a count of stages."""
    return Function(STAGE_OPERATOR, (Text(chain.name), Number(count)))


def said_of(atom: Atom) -> str:
    """An atom in words for people: that of a stage says how many stages of a chain are reached."""
    if atom.name != STAGE_FLUENT:
        return str(atom)
    chain, count = atom.arguments
    name = chain.value if isinstance(chain, Text) else chain
    return f"stage {count} of {name}"


Instances = Mapping[Function, list[GroundOperator]]


def operators_by_instance(task: GroundTask) -> Instances:
    """The ground operators of each instance.

    They differ in supports and in the stages that they reach.
    """
    operators: dict[Function, list[GroundOperator]] = {}
    for operator in task.operators:
        operators.setdefault(operator.instance, []).append(operator)
    return operators


def reaching_operators(task: GroundTask) -> list[GroundOperator]:
    """The internal operators that reach stages where a fluent holds."""
    return [operator for operator in task.operators if operator.instance.name == STAGE_OPERATOR]


def settling_operators(state: Bits, reaching: Sequence[GroundOperator]) -> Iterator[GroundOperator]:
    """The internal operators that are taken at once in a state, one after another."""
    while ready := [
        reaching_operator
        for reaching_operator in reaching
        if not reaching_operator.preconditions & ~state
    ]:
        for ready_operator in ready:
            if not ready_operator.preconditions & ~state:
                yield ready_operator
                state = progress_state(state, ready_operator)


def settle_stages(task: GroundTask, state: Bits) -> Bits:
    """A state in which every stage that may be reached, and holds, is reached."""
    for settling_operator in settling_operators(state, reaching_operators(task)):
        state = progress_state(state, settling_operator)
    return state


def _executable_step(task: GroundTask, step: GroundOperator, state: Bits) -> GroundOperator:
    """The step, or an operator with the same instance and effects whose conditions hold where those
    of the step do not.

    The other one may differ in the stages that it reaches: in another order of the steps an earlier
    one may have reached them.
    """
    if not step.preconditions & ~state:
        return step
    others = [
        o for o in task.operators if o.instance == step.instance and not o.preconditions & ~state
    ]
    alike = [
        other_operator
        for other_operator in others
        if (other_operator.adds, other_operator.deletes) == (step.adds, step.deletes)
    ]
    besides = ~_stage_atoms(task)
    alike += [o for o in others if not (o.adds ^ step.adds | o.deletes ^ step.deletes) & besides]
    return next(iter(alike), step)


def _stage_atoms(task: GroundTask) -> Bits:
    return bitset([number for number, atom in enumerate(task.atoms) if atom.name == STAGE_FLUENT])


def reach_stages_early(task: GroundTask, steps: Sequence[GroundOperator]) -> list[GroundOperator]:
    """The same steps with every stage reached as early as possible; as they are if that bars a
    step or a goal.
    """
    reaching = reaching_operators(task)
    if not reaching:
        return list(steps)
    state, replay = task.initial, list[GroundOperator]()
    for given_step in steps:
        if given_step.instance.name == STAGE_OPERATOR:
            continue
        step = _executable_step(task, given_step, state)
        if step.preconditions & ~state:
            return list(steps)
        state = task.after(state, step)
        replay.append(step)
        for settling_operator in settling_operators(state, reaching):
            state = task.after(state, settling_operator)
            replay.append(settling_operator)
    return replay if reached_goals(task, state) is not None else list(steps)


def join_stages(
    task: GroundTask, steps: Sequence[GroundOperator], goals: Bits
) -> tuple[list[GroundOperator], Bits]:
    """The steps, each with the stages that it reaches, and what must hold at the end for the goals.

    A stage that held before its step reached it, that still holds at the end, and that nothing
    waits for, is left to the end: nothing need be ordered for it.
    """
    stages = _stage_atoms(task)
    steps = reach_stages_early(task, steps)
    late, goals = _late_stages(task, steps, goals, stages)
    joined_steps: list[GroundOperator] = []
    before = state = task.initial
    for place, step in enumerate(steps):
        if step.instance.name != STAGE_OPERATOR:
            joined_steps.append(step)
            before = state
        elif joined_steps and place not in late:
            joined_steps[-1] = _add_stage(joined_steps[-1], step, before)
        state = progress_state(state, step)
    return joined_steps, goals


def _late_stages(
    task: GroundTask, steps: Sequence[GroundOperator], goals: Bits, stages: Bits
) -> tuple[frozenset[int], Bits]:
    """The places of internal operators that may wait for the end, and what then must hold there."""
    final = task.initial
    for step in steps:
        final = progress_state(final, step)
    needed, late, trigger = 0, list[int](), 0
    triggers = []
    for place, step in enumerate(steps):
        trigger = trigger if step.instance.name == STAGE_OPERATOR else place
        triggers.append(trigger)
    for place in reversed(range(len(steps))):
        step = steps[place]
        held = step.preconditions & ~step.deletes
        new = held & steps[triggers[place]].adds & ~stages
        if step.instance.name == STAGE_OPERATOR and not (
            step.adds & needed or held & ~final or new
        ):
            late.append(place)
            goals = goals & ~step.adds | step.preconditions
        else:
            needed |= step.preconditions
            if (
                step.instance.name == STAGE_OPERATOR and step.deletes & goals
            ):  # left to the end in another order
                goals = goals & ~step.deletes | step.adds
    return frozenset(late), goals


def _add_stage(step: GroundOperator, reaching: GroundOperator, before: Bits) -> GroundOperator:
    """A step that reaches one more stage; what held `before` it and it does not add, it needs."""
    held = reaching.preconditions & before & ~step.adds
    return replace(
        step,
        preconditions=step.preconditions | held,
        adds=step.adds & ~reaching.deletes | reaching.adds,
        deletes=step.deletes | reaching.deletes,
    )


def replay_instances(
    task: GroundTask, known: Instances, state: Bits, steps: Iterable[Function]
) -> list[GroundOperator] | None:
    """The operators of the task for instances that are applied one after another from a state, with
    the internal ones that reach stages between them; None if an instance cannot be applied.

    If several ground operators fit an instance, the one that reaches most stages is taken.
    """
    reaching, replayed_steps = reaching_operators(task), list[GroundOperator]()
    for instance in steps:
        fitting = [
            candidate
            for candidate in known.get(instance, ())
            if not candidate.preconditions & ~state
        ]
        if not fitting:
            return None
        best = max(fitting, key=lambda candidate: (candidate.adds & ~state).bit_count())
        replayed_steps.append(best)
        state = task.after(state, best)
        for settling_operator in settling_operators(state, reaching):
            replayed_steps.append(settling_operator)
            state = task.after(state, settling_operator)
    return replayed_steps


def reached_goals(task: GroundTask, state: Bits) -> Bits | None:
    """The alternative of the goals that holds in a closed state, with fluents from which its
    derived atoms follow.
    """
    goal_atoms = next((goal for goal in task.goals if not goal & ~state), None)
    return (
        goal_atoms
        if goal_atoms is None or task.axioms is None
        else task.axioms.support(state, goal_atoms)
    )


def reached_at_the_end(task: GroundTask, state: Bits) -> Bits | None:
    """As `reached_goals`, if the plan ended here: of atoms that only internal operators add at
    its end, it has what these need.
    """
    added: dict[Bits, Bits] = {
        each.adds: 0 for each in task.operators if each.instance.name == ENDS
    }
    ended = sum(added)
    for candidate in task.operators:
        if (
            candidate.instance.name == MEETS
            and not (needed := candidate.preconditions & ~ended) & ~state
        ):
            added.setdefault(candidate.adds, needed)
    whole = state
    for atoms in added:
        whole |= atoms
    goals_reached = reached_goals(replace(task, axioms=None), whole)
    for atoms, needed in added.items():
        if goals_reached is not None and goals_reached & atoms:
            goals_reached = goals_reached & ~atoms | needed
    return (
        goals_reached
        if goals_reached is None or task.axioms is None
        else task.axioms.support(state, goals_reached)
    )
