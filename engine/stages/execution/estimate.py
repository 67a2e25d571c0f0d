"""When an activity can begin at the soonest, from what is under way now.

The estimate looks back over a few unfinished predecessors only, so it is a lower bound and costs little.
"""

from collections.abc import Mapping

from cellwright.engine.stages.execution.program import Program

DEPTH = 12  # predecessors in a row that are looked at


def soonest(
    program: Program, ends: Mapping[int, int], ready: frozenset[int], now_ms: int, activity: int
) -> int:
    """The soonest start of an activity that has not begun; `ends` is when those under way will probably end."""
    known: dict[int, int] = {}

    def start(each: int, depth: int) -> int:
        if each in ready or depth == 0:
            return now_ms
        if each not in known:
            known[each] = max(
                (end(before, depth - 1) for before in program.activities[each].after), default=now_ms
            )
        return known[each]

    def end(each: int, depth: int) -> int:
        if each in ends:
            return max(now_ms, ends[each])
        if not _is_open(program, each, ready, ends, depth):
            return now_ms
        return start(each, depth) + program.activities[each].lasts_ms

    return start(activity, DEPTH)


def _is_open(program: Program, each: int, ready: frozenset[int], ends: Mapping[int, int], depth: int) -> bool:
    """Whether an activity has not ended, as far as can be seen from what is ready or under way."""
    if each in ready or each in ends:
        return True
    return depth > 0 and any(
        _is_open(program, b, ready, ends, depth - 1) for b in program.activities[each].after
    )
