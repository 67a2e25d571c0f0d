"""Cuts a plan into blocks, from picking up until the arm is free; removes detours.

Between its tasks the arm must be free. So removing needless orders alone would leave all its steps
in one fixed order. Blocks are the smallest segments that can be moved as a whole (block deordering:
Siddiqui & Haslum 2012). Some blocks serve an object of the workflow. Others only change a device
(door, lid); the schedule makes these anew where they are needed. Several arms each have blocks of
their own; a step of two arms is in a block of both.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

from cellwright.engine.kernels.bits import Bits, bitset, indices
from cellwright.engine.model.ground_task import GroundOperator, GroundTask, progress_state
from cellwright.engine.model.workflow_replay import STAGE_FLUENT
from cellwright.kb.model.plan_model import Step
from cellwright.kb.terms import Function, Term


class Unstructured(Exception):
    """A plan that cannot be cut into blocks, so it keeps its own order. The message says why."""


@dataclass(frozen=True, slots=True)
class Block:
    """Steps done one after another without a break; `subject` is the object of the workflow
    that they serve.
    """

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


def contains_term(term: Term, part: Term) -> bool:
    """Whether `part` is `term` or occurs in it."""
    return term == part or (
        isinstance(term, Function)
        and any(contains_term(argument, part) for argument in term.arguments)
    )


def arm_resource(steps: Sequence[GroundOperator | Step], subjects: Sequence[Term] = ()) -> Term:
    """The resource that most steps hold, beside the objects that they serve.

    Raises `Unstructured` if no step holds one.
    """
    held = Counter(
        resource for step in steps for resource in step.resources if resource not in subjects
    )
    if not held:
        raise Unstructured("no step holds a resource")
    return min(held, key=lambda resource: (-held[resource], str(resource)))


def arm_resources(
    steps: Sequence[GroundOperator], subjects: Sequence[Term] = ()
) -> tuple[Term, ...]:
    """The resource that most steps hold, and those that do the same kinds of steps in its place.

    Raises `Unstructured`.
    """
    return arms_to(steps, steps, subjects)


def arms_to(
    steps: Sequence[GroundOperator], able: Iterable[GroundOperator], subjects: Sequence[Term] = ()
) -> tuple[Term, ...]:
    """The resource that most steps hold, and those that can do the same kinds of steps, as
    operators in `able` say.

    `subjects` are the objects that steps serve, which are no arms. Raises `Unstructured`.
    """
    first = arm_resource(steps, subjects)
    kinds = {
        kind for step in steps for kind, resource in _resource_arguments(step) if resource == first
    }
    others = {
        resource for step in able for kind, resource in _resource_arguments(step) if kind in kinds
    } - {
        first,
        *subjects,
    }
    return (first, *sorted(others, key=str))


def _resource_arguments(step: GroundOperator) -> Iterator[tuple[tuple[str, int], Term]]:
    """The resources among the arguments of a step, each with the name of the operator and its
    place there.
    """
    for place, argument in enumerate(step.instance.arguments):
        if argument in step.resources:
            yield (step.instance.name, place), argument


def atoms_about(task: GroundTask, *terms: Term) -> Bits:
    """The atoms in which one of some terms occurs, complements included."""
    return bitset(
        [n for n, atom in enumerate(task.atoms) if any(contains_term(atom, term) for term in terms)]
    )


def cut_blocks(
    task: GroundTask,
    steps: Sequence[GroundOperator],
    arms: Sequence[Term],
    subjects: Sequence[Term],
) -> list[Block]:
    """The blocks of a plan in the order in which they begin; a step without an arm is its own
    block. Raises `Unstructured`.
    """
    about = {arm: atoms_about(task, arm) for arm in arms}
    home = {arm: home_state(task, steps, arm) for arm in arms}
    for arm in arms:
        if task.initial & about[arm] != home[arm]:
            raise Unstructured(f"{arm} is not free at the start")
    stages = bitset([number for number, atom in enumerate(task.atoms) if atom.name == STAGE_FLUENT])
    segments: list[_Segment] = []
    busy: dict[Term, _Segment] = {}
    state = task.initial
    for step in steps:
        after = progress_state(state, step)
        done = _Done(step, state & ~after, after & ~state)
        state = after
        own = [arm for arm in arms if arm in step.resources]
        now = _join_segments(segments, [busy[arm] for arm in own if arm in busy])
        now.done.append(done)
        now.arms.update(dict.fromkeys(own))
        busy |= dict.fromkeys(now.arms, now)
        if all(state & about[arm] == home[arm] for arm in now.arms):
            for arm in now.arms:
                del busy[arm]
    if busy:
        raise Unstructured(f"{min(map(str, busy))} is not free at the end")
    return [_block_of(segment, subjects, stages) for segment in segments]


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


def _join_segments(segments: list[_Segment], open_: Sequence[_Segment]) -> _Segment:
    """The segment that goes on: a new one, or the one that is open.

    Raises `Unstructured` if there are several.
    """
    several = list(dict.fromkeys(open_))
    if not several:
        segments.append(_Segment())
        return segments[-1]
    if len(several) > 1:
        raise Unstructured("two arms are busy with other steps when they meet")
    return several[0]


def home_state(task: GroundTask, steps: Sequence[GroundOperator], arm: Term) -> Bits:
    """What is most often true of the arm between its steps: this is the state in which it is
    free.
    """
    about, state = atoms_about(task, arm), task.initial
    seen = Counter([state & about])
    for step in steps:
        state = progress_state(state, step)
        if arm in step.resources:
            seen[state & about] += 1
    return max(seen, key=lambda seen_state: (seen[seen_state], -seen_state))


def _block_of(segment: _Segment, subjects: Sequence[Term], stages: Bits) -> Block:
    done = segment.done
    mentioned = [
        s for s in subjects if any(contains_term(done_step.step.instance, s) for done_step in done)
    ]
    if len(mentioned) > 1:
        raise Unstructured(f"one errand of an arm moves {' and '.join(map(str, mentioned))}")
    reaches = any((done_step.ends | done_step.makes) & stages for done_step in done)
    return Block(
        tuple(done_step.step for done_step in done),
        tuple(done_step.ends for done_step in done),
        tuple(done_step.makes for done_step in done),
        mentioned[0] if mentioned else None,
        bool(mentioned) or reaches,
        tuple(segment.arms),
    )


def atoms_touched(step: GroundOperator) -> Bits:
    """The atoms that a step needs or changes."""
    return step.preconditions | step.adds | step.deletes


def remove_detours(blocks: Sequence[Block], loose: Bits) -> list[Block]:
    """The blocks without detours, as far as the plan's order allows.

    The order of changes to atoms in `loose` may be changed.
    """
    kept = [block for block in blocks if not block.serves or changes_state(block)]
    place = 0
    while place < len(kept):
        following = _next_of_subject(kept, place)
        if following is not None and _undoes_end(kept[place], kept[following]):
            kept = _join_blocks(kept, place, following, ~loose) or kept
        place += 1
    return [block for block in kept if not block.serves or changes_state(block)]


def necessary_blocks(task: GroundTask, blocks: Sequence[Block], goals: Bits) -> list[Block]:
    """The blocks without those that serve no object of the workflow and that no later block
    needs.
    """
    kept = list(blocks)
    if not _reaches_goals(
        task, kept, goals
    ):  # a process began during a block, so the blocks in a row are not the plan
        return kept
    for block in [idle_block for idle_block in blocks if not idle_block.serves]:
        fewer = [kept_block for kept_block in kept if kept_block is not block]
        if _reaches_goals(task, fewer, goals):
            kept = fewer
    return kept


def _reaches_goals(task: GroundTask, blocks: Sequence[Block], goals: Bits) -> bool:
    state = task.initial
    for step in (step for block in blocks for step in block.steps):
        if step.preconditions & ~state:
            return False
        state = progress_state(state, step)
    return goals & ~state == 0


def changes_state(block: Block) -> bool:
    """Whether anything is different after a block.

    A block of one step always counts: it may be a process, and time passes.
    """
    state: dict[int, bool] = {}
    for ends, makes in zip(block.ends, block.makes, strict=True):
        state |= dict.fromkeys(indices(ends), False) | dict.fromkeys(indices(makes), True)
    first: dict[int, bool] = {}
    for ends, makes in zip(block.ends, block.makes, strict=True):
        for atom in indices(ends | makes):
            # an atom that is ended first was true before
            first.setdefault(atom, bool(ends >> atom & 1))
    return len(block.steps) == 1 or any(state[atom] != before for atom, before in first.items())


def _next_of_subject(blocks: Sequence[Block], place: int) -> int | None:
    """The index of the next block of the same object; None if there is none."""
    subject = blocks[place].subject
    later = range(place + 1, len(blocks))
    return (
        next((n for n in later if blocks[n].subject == subject), None)
        if subject is not None
        else None
    )


def _undoes_end(first: Block, second: Block) -> bool:
    """Whether the second block begins by undoing all that the first one ended with."""
    longer = len(first.steps) > 1 and len(second.steps) > 1
    return longer and (second.ends[0], second.makes[0]) == (first.makes[-1], first.ends[-1])


def _join_blocks(
    blocks: Sequence[Block], first: int, second: int, minded: Bits
) -> list[Block] | None:
    """The blocks with two of them made one, at the place of the first or the second; None if
    neither works.
    """
    first_block, second_block = blocks[first], blocks[second]
    between = list(blocks[first + 1 : second])
    changed = 0
    for block in between:
        for bits in (*block.ends, *block.makes):
            changed |= bits & minded
    steps = first_block.steps[:-1] + second_block.steps[1:]
    ends, makes = (
        first_block.ends[:-1] + second_block.ends[1:],
        first_block.makes[:-1] + second_block.makes[1:],
    )
    joined = Block(steps, ends, makes, first_block.subject, True, first_block.arms)
    if not any(bits & changed for bits in (*second_block.ends[1:], *second_block.makes[1:])):
        return [*blocks[:first], joined, *between, *blocks[second + 1 :]]
    if not any(bits & changed for bits in (*first_block.ends[:-1], *first_block.makes[:-1])):
        return [*blocks[:first], *between, joined, *blocks[second + 1 :]]
    return None
