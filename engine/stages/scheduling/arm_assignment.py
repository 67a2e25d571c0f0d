"""Shares the blocks of a plan out among arms that can do the same steps.

A search looks at costs, so it is content with one arm. A plan of one arm has its blocks one after
another, and between them the arm is free. So another arm can do any of them at the same place of
the plan; the scheduler then has the arms work at once. A few ways to share the blocks are worth a
try: by their number within a job, so that one arm brings and the other takes away, and by the job.
"""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

from cellwright.engine.kernels.bits import Bits, bitset, indices
from cellwright.engine.model.ground_task import GroundOperator, GroundTask, progress_state
from cellwright.engine.stages.scheduling.place_holds import exchange_in_atom
from cellwright.engine.stages.scheduling.plan_blocks import (
    Block,
    arm_resources,
    arms_to,
    cut_blocks,
)
from cellwright.kb.terms import Function, Term

# from the number of a job, of a block in it, and of arms: which arm
Chosen = Callable[[int, int, int], int]
ASSIGNMENT_RULES: tuple[Chosen, ...] = (
    lambda _job, block, arms: block % arms,
    lambda _job, block, arms: (block + 1) % arms,
    lambda job, _block, arms: job % arms,
    lambda _job, block, arms: 0 if block else 1 % arms,
)


def shared_out(
    task: GroundTask, steps: Sequence[GroundOperator], subjects: Sequence[Term]
) -> Iterator[tuple[GroundOperator, ...]]:
    """The steps with their blocks shared out among all arms of the task, in each way that can
    be done. Raises `Unstructured`.
    """
    hands = arms_to(steps, task.operators, subjects)
    own = arm_resources(steps, subjects)
    if len(hands) < 2:
        return
    blocks, tried = cut_blocks(task, steps, own, subjects), set[tuple[Function, ...]]()
    known = {operator.instance: operator for operator in task.operators}
    for way in ASSIGNMENT_RULES:
        chosen = _steps_by_arms(task, known, _assign_arms(blocks, subjects, way, hands))
        if (
            chosen is not None
            and (named := tuple(chosen_step.instance for chosen_step in chosen)) not in tried
        ):
            tried.add(named)
            yield chosen


def _assign_arms(
    blocks: Sequence[Block], subjects: Sequence[Term], way: Chosen, hands: Sequence[Term]
) -> Iterator[tuple[Block, Term | None]]:
    """Each block with the arm that is to do it; None for one that no single arm does, or that
    prepares a device.
    """
    numbers = {subject: n for n, subject in enumerate(subjects)}
    count = Counter[Term | None]()
    for block in blocks:
        if len(block.arms) != 1 or not block.serves:
            yield block, None
            continue
        job = numbers.get(block.subject, 0) if block.subject is not None else 0
        yield block, hands[way(job, count[block.subject], len(hands))]
        count[block.subject] += 1


def _steps_by_arms(
    task: GroundTask,
    known: dict[Function, GroundOperator],
    assigned: Iterator[tuple[Block, Term | None]],
) -> tuple[GroundOperator, ...] | None:
    """The steps of blocks one after another, each by its arm; None if a step cannot be done so."""
    state, done_steps = task.initial, list[GroundOperator]()
    index = {atom: number for number, atom in enumerate(task.atoms)}
    for block, hand in assigned:
        for step in block.steps:
            made = (
                step
                if hand in (None, *block.arms)
                else _step_by_arm(hand, step, block.arms[0], known, task, index)
            )
            if made is None or made.preconditions & ~state:
                return None
            done_steps.append(made)
            state = progress_state(state, made)
    return tuple(done_steps)


def _step_by_arm(
    hand: Term | None,
    step: GroundOperator,
    own: Term,
    known: dict[Function, GroundOperator],
    task: GroundTask,
    index: dict[Function, int],
) -> GroundOperator | None:
    """A step by another arm; None if the task has no such step."""
    assert hand is not None
    same = known.get(exchange_in_atom(step.instance, own, hand))
    if same is None:
        return None

    def moved(bits: Bits) -> Bits | None:
        numbers = [index.get(exchange_in_atom(task.atoms[n], own, hand)) for n in indices(bits)]
        return None if None in numbers else bitset([n for n in numbers if n is not None])

    sets = [moved(atoms) for atoms in (step.preconditions, step.adds, step.deletes)]
    needs, adds, deletes = sets
    if needs is None or adds is None or deletes is None:
        return None
    return replace(
        step,
        instance=same.instance,
        preconditions=needs,
        adds=adds,
        deletes=deletes,
        resources=same.resources,
        duration=same.duration,
        cost=same.cost,
    )
