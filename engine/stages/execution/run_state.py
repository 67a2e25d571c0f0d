"""The executive's state: what is under way, what can begin, who holds which resource."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

from cellwright.engine.model.run_protocol import RunPhase
from cellwright.engine.stages.execution.activity_program import Activity, ActivityProgram, Dwell
from cellwright.engine.stages.execution.run_events import Failure


@dataclass(frozen=True, slots=True)
class Running:
    """An activity whose command was sent. Its time counts from `since_ms`."""

    activity: int
    since_ms: int


@dataclass(frozen=True, slots=True)
class ExecutiveState:
    """The state of an executive.

    `ready` are the activities whose predecessors have ended; `open` counts, for the others that
    have lost some, how many they still wait for. `heads` is the place of the first activity in the
    queue of each resource that has not begun, `ahead` are those behind it that have. `busy` says
    who holds a resource (the last one, if several are queued in one stream). `unrested` are hands
    that hold something on the way to a goal; while it is `frozen`, no hand begins anything. `waits`
    are the WAITs that were sent, with the activities that they wait for. `dwelling` are deadlines
    of waits. Where a policy is followed, `begun_ms` and `ended_ms` say when activities have.
    """

    phase: RunPhase
    now_ms: int
    number: int  # the next command
    ready: frozenset[int]
    open: Mapping[int, int] = field(default_factory=dict)
    running: Mapping[int, Running] = field(default_factory=dict)
    busy: Mapping[str, int] = field(default_factory=dict)
    heads: Mapping[str, int] = field(default_factory=dict)
    ahead: frozenset[int] = frozenset()
    waits: Mapping[int, tuple[str, frozenset[int]]] = field(default_factory=dict)
    unrested: frozenset[str] = frozenset()
    frozen: bool = False
    dwelling: Mapping[Dwell, int] = field(default_factory=dict)
    warned: frozenset[tuple[Dwell, bool]] = frozenset()
    failures: tuple[Failure, ...] = ()
    done: int = 0
    begun_ms: Mapping[int, int] = field(default_factory=dict)
    ended_ms: Mapping[int, int] = field(default_factory=dict)

    def finished(self, program: ActivityProgram) -> bool:
        """Whether every activity has ended."""
        return self.done == len(program.activities)


def standing_of(
    program: ActivityProgram,
    now_ms: int,
    number: int,
    phase: RunPhase = RunPhase.READY,
    done: Collection[int] = (),
    running: Mapping[int, Running] | None = None,
    ends: Mapping[int, int] | None = None,
    unrested: frozenset[str] = frozenset(),
) -> ExecutiveState:
    """The standing of a program in which some activities are done (`ends`: when, for waits) and
    some are running.
    """
    underway = dict(running or {})
    begun = {*done, *(command_underway.activity for command_underway in underway.values())}
    ready, partly = set[int](), dict[int, int]()
    finished = set(done)
    for activity in program.activities.values():
        if activity.id in begun:
            continue
        left = sum(before not in finished for before in activity.after)
        if not left:
            ready.add(activity.id)
        elif left < len(activity.after):
            partly[activity.id] = left
    heads, ahead = _queue_heads(program, begun)
    busy = {
        r: command_underway.activity
        for command_underway in underway.values()
        for r in program.activities[command_underway.activity].resources
    }
    dwelling = _dwell_ends(program, ends or {}, begun)
    begun_ms, ended_ms = _past_times(program, ends or {}, underway)
    return ExecutiveState(
        phase, now_ms, number, frozenset(ready), partly, underway, busy, heads, ahead, {}, unrested,
        False, dwelling, done=len(finished), begun_ms=begun_ms, ended_ms=ended_ms,
    )  # fmt: skip


def _past_times(
    program: ActivityProgram, ends: Mapping[int, int], running: Mapping[int, Running]
) -> tuple[dict[int, int], dict[int, int]]:
    """When activities have begun and ended, for a program that follows a policy. One that has ended
    counts as begun no sooner: whatever waits for it then rather begins later.
    """
    if not program.follows_rules:
        return {}, {}
    since = {under_way.activity: under_way.since_ms for under_way in running.values()}
    return {**ends, **since}, dict(ends)


def _dwell_ends(
    program: ActivityProgram, ends: Mapping[int, int], begun: Collection[int]
) -> dict[Dwell, int]:
    """Until when each thing may stay that waits for a step that has not begun."""
    dwell_ends = {
        dwell: when + dwell.most_ms
        for source, when in ends.items()
        for dwell in program.ending_in.get(source, ())
        if dwell.target not in begun
    }
    return dwell_ends | {
        dwell: dwell.since_ms + dwell.most_ms
        for dwell in program.dwells
        if dwell.since_ms is not None and dwell.target not in begun
    }


def _queue_heads(
    program: ActivityProgram, begun: Collection[int]
) -> tuple[dict[str, int], frozenset[int]]:
    heads, ahead = {}, set[int]()
    for resource, queue in program.queues.items():
        place = next((n for n, queued in enumerate(queue) if queued not in begun), len(queue))
        heads[resource] = place
        ahead |= {queued for queued in queue[place:] if queued in begun}
    return heads, frozenset(ahead)


def reply_deadline(activity: Activity, since_ms: int) -> int | None:
    """When an activity without a reply counts as failed."""
    return None if activity.timeout_ms is None else since_ms + activity.timeout_ms


def unrested_after(
    unrested: frozenset[str], activity: Activity, hands: Collection[str] = ()
) -> frozenset[str]:
    """The hands that hold something on the way to a goal when an activity has ended; without
    `hands`, all resources count.
    """
    if activity.process:
        return unrested
    used = frozenset(resource for resource in activity.resources if not hands or resource in hands)
    return unrested - used if activity.rests else unrested | used
