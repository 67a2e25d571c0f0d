"""Cuts a task-level plan into blocks: what the arm does from picking something up until it is free again.

Between its tasks the arm must be free. So removing needless orders alone would leave all its steps in one
fixed order. Blocks are the smallest segments that can be moved as a whole (block deordering: Siddiqui &
Haslum 2012). Some blocks serve an object of the workflow. Others only change a device (door, lid); the
schedule makes these anew where they are needed. Several arms each have blocks of their own; a step of two arms is in a
block of both.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

from cellwright.engine.model.stages import STAGE
from cellwright.engine.model.task import Bits, GroundOperator, Task, bitset, progress
from cellwright.kb.model.plan import Step
from cellwright.kb.terms import Function, Term


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
    arms: tuple[Term, ...] = ()  # that are busy with it

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


def arm_of(steps: Sequence[GroundOperator | Step], subjects: Sequence[Term] = ()) -> Term:
    """The resource that most steps hold, beside the objects that they serve. Raises `Unstructured` if no step holds one."""
    held = Counter(each for step in steps for each in step.resources if each not in subjects)
    if not held:
        raise Unstructured("no step holds a resource")
    return min(held, key=lambda each: (-held[each], str(each)))


def arms_of(steps: Sequence[GroundOperator], subjects: Sequence[Term] = ()) -> tuple[Term, ...]:
    """The resource that most steps hold, and those that do the same kinds of steps in its place. Raises `Unstructured`."""
    return arms_to(steps, steps, subjects)


def arms_to(
    steps: Sequence[GroundOperator], able: Iterable[GroundOperator], subjects: Sequence[Term] = ()
) -> tuple[Term, ...]:
    """The resource that most steps hold, and those that can do the same kinds of steps, as operators in `able` say.

    `subjects` are the objects that steps serve, which are no arms. Raises `Unstructured`.
    """
    first = arm_of(steps, subjects)
    kinds = {kind for step in steps for kind, each in _held(step) if each == first}
    others = {each for step in able for kind, each in _held(step) if kind in kinds} - {first, *subjects}
    return (first, *sorted(others, key=str))


def _held(step: GroundOperator) -> Iterator[tuple[tuple[str, int], Term]]:
    """The resources among the arguments of a step, each with the name of the operator and its place there."""
    for place, each in enumerate(step.instance.arguments):
        if each in step.resources:
            yield (step.instance.name, place), each


def atoms_about(task: Task, *terms: Term) -> Bits:
    """The atoms in which one of some terms occurs, complements included."""
    return bitset([n for n, atom in enumerate(task.atoms) if any(mentions(atom, each) for each in terms)])


def cut(
    task: Task, steps: Sequence[GroundOperator], arms: Sequence[Term], subjects: Sequence[Term]
) -> list[Block]:
    """The blocks of a plan in the order in which they begin; a step without an arm is its own block. Raises `Unstructured`."""
    about = {arm: atoms_about(task, arm) for arm in arms}
    home = {arm: home_state(task, steps, arm) for arm in arms}
    for arm in arms:
        if task.initial & about[arm] != home[arm]:
            raise Unstructured(f"{arm} is not free at the start")
    stages = bitset([number for number, atom in enumerate(task.atoms) if atom.name == STAGE])
    found: list[_Segment] = []
    busy: dict[Term, _Segment] = {}
    state = task.initial
    for step in steps:
        after = progress(state, step)
        done = _Done(step, state & ~after, after & ~state)
        state = after
        own = [arm for arm in arms if arm in step.resources]
        now = _joined(found, [busy[arm] for arm in own if arm in busy])
        now.done.append(done)
        now.arms.update(dict.fromkeys(own))
        busy |= dict.fromkeys(now.arms, now)
        if all(state & about[arm] == home[arm] for arm in now.arms):
            for arm in now.arms:
                del busy[arm]
    if busy:
        raise Unstructured(f"{min(map(str, busy))} is not free at the end")
    return [_block(each, subjects, stages) for each in found]


@dataclass(frozen=True, slots=True)
class _Done:
    step: GroundOperator
    ends: Bits
    makes: Bits


@dataclass(frozen=True, slots=True, eq=False)
class _Segment:
    """Steps of the plan that may become a block, and the arms that do them."""

    done: list[_Done] = field(default_factory=list)
    arms: dict[Term, None] = field(default_factory=dict)


def _joined(found: list[_Segment], open_: Sequence[_Segment]) -> _Segment:
    """The segment that goes on: a new one, or the one that is open. Raises `Unstructured` if there are several."""
    several = list(dict.fromkeys(open_))
    if not several:
        found.append(_Segment())
        return found[-1]
    if len(several) > 1:
        raise Unstructured("two arms are busy with other steps when they meet")
    return several[0]


def home_state(task: Task, steps: Sequence[GroundOperator], arm: Term) -> Bits:
    """What is most often true of the arm between its steps: this is the state in which it is free."""
    about, state = atoms_about(task, arm), task.initial
    seen = Counter([state & about])
    for step in steps:
        state = progress(state, step)
        if arm in step.resources:
            seen[state & about] += 1
    return max(seen, key=lambda each: (seen[each], -each))


def _block(segment: _Segment, subjects: Sequence[Term], stages: Bits) -> Block:
    done = segment.done
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
        tuple(segment.arms),
    )


def touched(step: GroundOperator) -> Bits:
    """The atoms that a step needs or changes."""
    return step.preconditions | step.adds | step.deletes
