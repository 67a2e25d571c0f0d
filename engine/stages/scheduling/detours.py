"""Removes detours from a plan: an object is put down and picked up again, with nothing done to it in between.

The plan may park an object because its next place is not free yet, or without need. A schedule may reorder
blocks, so it need not park the object. The two blocks become one, without the steps that undo each other.
"""

from collections.abc import Sequence

from cellwright.engine.model.task import Bits, Task, indices, progress
from cellwright.engine.stages.scheduling.blocks import Block


def straightened(blocks: Sequence[Block], loose: Bits) -> list[Block]:
    """The blocks without detours, as far as the plan's order allows.

    The order of changes to atoms in `loose` may be changed.
    """
    kept = [block for block in blocks if not block.serves or changes(block)]
    place = 0
    while place < len(kept):
        following = _next(kept, place)
        if following is not None and _undone(kept[place], kept[following]):
            kept = _joined(kept, place, following, ~loose) or kept
        place += 1
    return [block for block in kept if not block.serves or changes(block)]


def necessary(task: Task, blocks: Sequence[Block], goals: Bits) -> list[Block]:
    """The blocks without those that serve no object of the workflow and that no later block needs."""
    kept = list(blocks)
    if not _executes(
        task, kept, goals
    ):  # a process began during a block, so the blocks in a row are not the plan
        return kept
    for block in [each for each in blocks if not each.serves]:
        fewer = [each for each in kept if each is not block]
        if _executes(task, fewer, goals):
            kept = fewer
    return kept


def _executes(task: Task, blocks: Sequence[Block], goals: Bits) -> bool:
    state = task.initial
    for step in (step for block in blocks for step in block.steps):
        if step.preconditions & ~state:
            return False
        state = progress(state, step)
    return goals & ~state == 0


def changes(block: Block) -> bool:
    """Whether anything is different after a block.

    A block of one step always counts: it may be a process, and time passes.
    """
    state: dict[int, bool] = {}
    for ends, makes in zip(block.ends, block.makes, strict=True):
        state |= dict.fromkeys(indices(ends), False) | dict.fromkeys(indices(makes), True)
    first: dict[int, bool] = {}
    for ends, makes in zip(block.ends, block.makes, strict=True):
        for atom in indices(ends | makes):
            first.setdefault(atom, bool(ends >> atom & 1))  # an atom that is ended first was true before
    return len(block.steps) == 1 or any(state[atom] != before for atom, before in first.items())


def _next(blocks: Sequence[Block], place: int) -> int | None:
    """The index of the next block of the same object; None if there is none."""
    subject = blocks[place].subject
    later = range(place + 1, len(blocks))
    return next((n for n in later if blocks[n].subject == subject), None) if subject is not None else None


def _undone(first: Block, second: Block) -> bool:
    """Whether the second block begins by undoing all that the first one ended with."""
    longer = len(first.steps) > 1 and len(second.steps) > 1
    return longer and (second.ends[0], second.makes[0]) == (first.makes[-1], first.ends[-1])


def _joined(blocks: Sequence[Block], first: int, second: int, minded: Bits) -> list[Block] | None:
    """The blocks with two of them made one, at the place of the first or the second; None if neither works."""
    one, other = blocks[first], blocks[second]
    between = list(blocks[first + 1 : second])
    changed = 0
    for block in between:
        for bits in (*block.ends, *block.makes):
            changed |= bits & minded
    steps = one.steps[:-1] + other.steps[1:]
    ends, makes = one.ends[:-1] + other.ends[1:], one.makes[:-1] + other.makes[1:]
    joined = Block(steps, ends, makes, one.subject, True, one.arms)
    if not any(bits & changed for bits in (*other.ends[1:], *other.makes[1:])):
        return [*blocks[:first], joined, *between, *blocks[second + 1 :]]
    if not any(bits & changed for bits in (*one.ends[:-1], *one.makes[:-1])):
        return [*blocks[:first], *between, joined, *blocks[second + 1 :]]
    return None
