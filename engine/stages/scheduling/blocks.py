"""Cuts a task-level plan into blocks: what the arm does from picking something up until it is free again.

Between its tasks the arm must be free. So removing needless orders alone would leave all its steps in one
fixed order. Blocks are the smallest segments that can be moved as a whole (block deordering: Siddiqui &
Haslum 2012). Some blocks serve an object of the workflow. Others only change a device (door, lid); the
schedule makes these anew where they are needed.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from engine.model.stages import STAGE
from engine.model.task import Bits, GroundOperator, Task, bitset, progress
from kb.model.plan import Step
from kb.terms import Function, Term


class Unstructured(Exception):
    """A plan that cannot be cut into blocks, so it keeps its own order. The message says why."""


@dataclass(frozen=True, slots=True)
class Block:
    """Steps done one after another without a break; `subject` is the object of the workflow that they serve."""

    steps: tuple[GroundOperator, ...]
    ends: tuple[Bits, ...]  # for each step, the atoms that were true and that it ends
    makes: tuple[Bits, ...]  # for each step, the atoms that were false and that it makes true
    subject: Term | None
    serves: bool  # whether it serves an object or a stage; else it only prepares a device

    @property
    def duration(self) -> int:
        """The sum of the durations of the steps."""
        return sum(step.duration for step in self.steps)

    @property
    def timed(self) -> Iterator[tuple[GroundOperator, int, int]]:
        """Each step with its begin and end, counted from the start of the block."""
        now = 0
        for step in self.steps:
            yield step, now, now + step.duration
            now += step.duration


def mentions(term: Term, part: Term) -> bool:
    """Whether `part` is `term` or occurs in it."""
    return term == part or (
        isinstance(term, Function) and any(mentions(each, part) for each in term.arguments)
    )


def arm_of(steps: Sequence[GroundOperator | Step]) -> Term:
    """The resource that most steps hold. Raises `Unstructured` if no step holds a resource."""
    held = Counter(resource for step in steps for resource in step.resources)
    if not held:
        raise Unstructured("no step holds a resource")
    return min(held, key=lambda each: (-held[each], str(each)))


def atoms_about(task: Task, term: Term) -> Bits:
    """The atoms in which a term occurs, complements included."""
    return bitset([number for number, atom in enumerate(task.atoms) if mentions(atom, term)])


def cut(task: Task, steps: Sequence[GroundOperator], arm: Term, subjects: Sequence[Term]) -> list[Block]:
    """The blocks of a plan in its order; a step without the arm is its own block. Raises `Unstructured`."""
    about = atoms_about(task, arm)
    home = home_state(task, steps, arm)
    if task.initial & about != home:
        raise Unstructured(f"{arm} is not free at the start")
    stages = bitset([number for number, atom in enumerate(task.atoms) if atom.name == STAGE])
    found: list[list[_Done]] = []
    unfinished: list[_Done] = []
    state = task.initial
    for step in steps:
        after = progress(state, step)
        done = _Done(step, state & ~after, after & ~state)
        state = after
        if arm not in step.resources:
            found.append([done])
            continue
        if not unfinished:
            found.append(unfinished)
        unfinished.append(done)
        if state & about == home:
            unfinished = []
    if unfinished:
        raise Unstructured(f"{arm} is not free at the end")
    return [_block(each, subjects, stages) for each in found]


@dataclass(frozen=True, slots=True)
class _Done:
    step: GroundOperator
    ends: Bits
    makes: Bits


def home_state(task: Task, steps: Sequence[GroundOperator], arm: Term) -> Bits:
    """What is most often true of the arm between its steps: this is the state in which it is free."""
    about, state = atoms_about(task, arm), task.initial
    seen = Counter([state & about])
    for step in steps:
        state = progress(state, step)
        if arm in step.resources:
            seen[state & about] += 1
    return max(seen, key=lambda each: (seen[each], -each))


def _block(done: Sequence[_Done], subjects: Sequence[Term], stages: Bits) -> Block:
    mentioned = [s for s in subjects if any(mentions(each.step.instance, s) for each in done)]
    if len(mentioned) > 1:
        raise Unstructured(f"{' and '.join(map(str, mentioned))} are moved by one block")
    reaches = any((each.ends | each.makes) & stages for each in done)
    return Block(
        tuple(each.step for each in done),
        tuple(each.ends for each in done),
        tuple(each.makes for each in done),
        mentioned[0] if mentioned else None,
        bool(mentioned) or reaches,
    )


def touched(step: GroundOperator) -> Bits:
    """The atoms that a step needs or changes."""
    return step.preconditions | step.adds | step.deletes
