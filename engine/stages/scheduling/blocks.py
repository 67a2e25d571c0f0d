"""A task-level plan cut into blocks: what the arm does from taking something up to being free again.

All that an arm does passes through its being free, so that deordering alone leaves one order of all its steps. Blocks
are the smallest segments that can be moved as a whole (block deordering: Siddiqui & Haslum 2012). Blocks that only
change a device (doors, lids) are told from those that serve an object of the workflow: they are made anew where needed.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from engine.model.stages import STAGE
from engine.model.task import Bits, GroundOperator, Task, bitset, progress
from kb.terms import Function, Term


class Unstructured(Exception):
    """A plan whose blocks cannot be told apart; its own order is all there is."""


@dataclass(frozen=True, slots=True)
class Block:
    """Steps done one after another without a break; `subject` is the object of the workflow that they serve."""

    steps: tuple[GroundOperator, ...]
    ends: tuple[Bits, ...]  # for each step the atoms that it ends, of those true in the plan
    makes: tuple[Bits, ...]  # for each step the atoms that it makes true
    subject: Term | None
    serves: bool  # an object or a stage; else it only prepares a device

    @property
    def duration(self) -> int:
        """How long all its steps last."""
        return sum(step.duration for step in self.steps)

    @property
    def timed(self) -> Iterator[tuple[GroundOperator, int, int]]:
        """Each step with its begin and end from the start of the block."""
        now = 0
        for step in self.steps:
            yield step, now, now + step.duration
            now += step.duration


def mentions(term: Term, part: Term) -> bool:
    """Whether `part` is `term` or stands somewhere in it."""
    return term == part or (
        isinstance(term, Function) and any(mentions(each, part) for each in term.arguments)
    )


def arm_of(steps: Sequence[GroundOperator]) -> Term:
    """The resource that most steps hold. Raises `Unstructured` if none holds any."""
    held = Counter(resource for step in steps for resource in step.resources)
    if not held:
        raise Unstructured("no step holds a resource")
    return min(held, key=lambda each: (-held[each], str(each)))


def atoms_about(task: Task, term: Term) -> Bits:
    """The atoms that a term stands in, complements included."""
    return bitset([number for number, atom in enumerate(task.atoms) if mentions(atom, term)])


def cut(task: Task, steps: Sequence[GroundOperator], arm: Term, subjects: Sequence[Term]) -> list[Block]:
    """The blocks of a plan, in its order; steps without the arm are blocks of their own. Raises `Unstructured`."""
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
    """What is most often true of the arm between its steps: that it is free."""
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
