"""Which activities begin now: their predecessors have ended, their resources are free.

One that stands behind others on a resource may overtake them only if it ends before the soonest of
them can begin. Streams that take several commands at once get them ahead of time, with a WAIT
before each that waits for another stream (ITA).
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace

from cellwright.engine.stages.execution.activity_program import Activity, ActivityProgram
from cellwright.engine.stages.execution.rule_following import allowed_start
from cellwright.engine.stages.execution.run_events import Dispatch
from cellwright.engine.stages.execution.run_state import ExecutiveState, Running

MAX_LOOKBACK = 12  # predecessors in a row that are looked at


def soonest_start(
    program: ActivityProgram,
    ends: Mapping[int, int],
    ready: frozenset[int],
    now_ms: int,
    activity: int,
) -> int:
    """The soonest start of an activity that has not begun; `ends` is when those under way will
    probably end.
    """
    known: dict[int, int] = {}

    def start(successor: int, depth: int) -> int:
        if successor in ready or depth == 0:
            return now_ms
        if successor not in known:
            known[successor] = max(
                (end(before, depth - 1) for before in program.activities[successor].after),
                default=now_ms,
            )
        return known[successor]

    def end(predecessor: int, depth: int) -> int:
        if predecessor in ends:
            return max(now_ms, ends[predecessor])
        if not _is_open(program, predecessor, ready, ends, depth):
            return now_ms
        return start(predecessor, depth) + program.activities[predecessor].lasts_ms

    return start(activity, MAX_LOOKBACK)


def _is_open(
    program: ActivityProgram,
    predecessor: int,
    ready: frozenset[int],
    ends: Mapping[int, int],
    depth: int,
) -> bool:
    """Whether an activity has not ended, as far as can be seen from what is ready or under way."""
    if predecessor in ready or predecessor in ends:
        return True
    return depth > 0 and any(
        _is_open(program, b, ready, ends, depth - 1) for b in program.activities[predecessor].after
    )


def dispatch_activities(
    program: ActivityProgram, standing: ExecutiveState
) -> tuple[ExecutiveState, tuple[Dispatch, ...]]:
    """The standing after everything that can begin has begun, and the commands for it."""
    board = _DispatchBoard(program, standing)
    if standing.ready:
        board.begin_ready()
    if program.lookahead:
        board.queue()
    return board.standing(), tuple(board.sent)


class _DispatchBoard:
    """A standing while activities are being begun on it."""

    def __init__(self, program: ActivityProgram, standing: ExecutiveState) -> None:
        self.program, self.old = program, standing
        self.ready, self.running = set(standing.ready), dict(standing.running)
        self.busy, self.heads, self.ahead = (
            dict(standing.busy),
            dict(standing.heads),
            set(standing.ahead),
        )
        self.open, self.waits, self.number = (
            dict(standing.open),
            dict(standing.waits),
            standing.number,
        )
        self.begun = dict(standing.begun_ms) if program.follows_rules else {}
        self.sent: list[Dispatch] = []

    def standing(self) -> ExecutiveState:
        """The standing that has come of it."""
        if not self.sent:
            return self.old
        return replace(
            self.old,
            ready=frozenset(self.ready),
            running=self.running,
            busy=self.busy,
            heads=self.heads,
            ahead=frozenset(self.ahead),
            open=self.open,
            waits=self.waits,
            number=self.number,
            begun_ms=self.begun,
        )

    def begin_ready(self) -> None:
        """Begin what is ready and may begin, in the order of the forecast. By the rules of a policy
        one that has begun may let others begin at the same time.
        """
        waiting = sorted(self.old.ready, key=lambda n: (self.program.activities[n].start_ms, n))
        sent = -1
        while waiting and len(self.sent) > sent:
            sent = len(self.sent)
            for number in waiting:
                self.begin(self.program.activities[number])
            waiting = [number for number in waiting if number in self.ready]
            if not self.program.follows_rules:
                return

    def begin(self, activity: Activity) -> None:
        """Begin an activity that is ready, if it may begin now."""
        old = self.old
        early = self._is_early(activity)
        kept = old.frozen and not activity.process
        if early or kept or any(resource in self.busy for resource in activity.resources):
            return
        if self.program.lookahead.get(activity.stream, 1) > 1 and self._in_stream(activity.stream):
            return
        if activity.rule is not None or all(
            self._delays_nobody(activity, resource) for resource in activity.resources
        ):
            self._send(activity)

    def _is_early(self, activity: Activity) -> bool:
        """Whether an activity may not begin yet, by its rule or else by its forecast."""
        if activity.rule is None:
            return self.program.timed and activity.start_ms > self.old.now_ms
        begun = replace(self.old, begun_ms=self.begun)
        start = allowed_start(self.program, begun, activity.rule)
        return start is None or start > self.old.now_ms

    def _delays_nobody(self, activity: Activity, resource: str) -> bool:
        """Whether those that stand before an activity on a resource can begin no sooner than it
        ends.
        """
        place, queue = self.program.places[activity.id][resource], self.program.queues[resource]
        before = [
            queued for queued in queue[self.heads[resource] : place] if queued not in self.ahead
        ]
        if not before:
            return True
        end = self.old.now_ms + activity.lasts_ms
        return all(end <= self._soonest(queued) for queued in before)

    def _soonest(self, activity: int) -> int:
        ends = {
            r.activity: r.since_ms + self.program.activities[r.activity].lasts_ms
            for r in self.running.values()
        }
        return soonest_start(self.program, ends, frozenset(self.ready), self.old.now_ms, activity)

    def _send(self, activity: Activity) -> None:
        self.sent.append(Dispatch(self.number, activity.id, activity.stream))
        self.running[self.number] = Running(activity.id, self.old.now_ms)
        self.number += 1
        if self.program.follows_rules:
            self.begun[activity.id] = self.old.now_ms
        self.ready.discard(activity.id)
        self.open.pop(activity.id, None)
        self.ahead.add(activity.id)
        for resource in activity.resources:
            self.busy[resource] = activity.id
        for resource in activity.resources:
            self._advance(resource)

    def _advance(self, resource: str) -> None:
        """Move the head of a queue behind those that have begun."""
        queue, head = self.program.queues[resource], self.heads[resource]
        while head < len(queue) and queue[head] in self.ahead:
            self.heads[resource] = head = head + 1
            passed = queue[head - 1]
            if all(self.heads[r] > place for r, place in self.program.places[passed].items()):
                self.ahead.discard(passed)
        if not self.program.activities[queue[head - 1]].resources:
            self.ahead.discard(queue[head - 1])

    def _in_stream(self, stream: str) -> list[int]:
        return [
            r.activity
            for r in self.running.values()
            if self.program.activities[r.activity].stream == stream
        ]

    def queue(self) -> None:
        """Fill the queues of the streams that look ahead."""
        for stream, depth in self.program.lookahead.items():
            if depth < 2 or self.old.frozen:
                continue
            while len(self._in_stream(stream)) < depth and (
                next_activity := next(self._next_in(stream), None)
            ):
                activity, awaited = next_activity
                if awaited:
                    self.sent.append(Dispatch(self.number, None, stream))
                    self.waits[self.number] = (stream, awaited)
                    self.number += 1
                self._send(activity)

    def _next_in(self, stream: str) -> Iterator[tuple[Activity, frozenset[int]]]:
        """The next activity of a stream if all that it waits for is under way, and what of that
        is in other streams.
        """
        own = frozenset(self._in_stream(stream))
        others = frozenset(r.activity for r in self.running.values()) - own
        for candidate in self._candidates(own | others):
            activity = self.program.activities[candidate]
            if activity.stream != stream or (
                self.program.timed and activity.start_ms > self.old.now_ms
            ):
                continue
            awaited = {before for before in activity.after if before in others}
            awaited |= {self.busy[r] for r in activity.resources if self.busy.get(r) in others}
            if all(self._is_next(activity, resource) for resource in activity.resources):
                yield activity, frozenset(awaited)

    def _candidates(self, underway: frozenset[int]) -> list[int]:
        """The activities that wait only for what is under way, in the forecast's order."""
        later = (
            {
                successor
                for activity_underway in underway
                for successor in self.program.successors[activity_underway]
            }
            - self.ahead
            - underway
        )
        waiting = {candidate for candidate in later if self._waits_only_for(candidate, underway)}
        return sorted(
            waiting | self.ready,
            key=lambda candidate: (self.program.activities[candidate].start_ms, candidate),
        )

    def _waits_only_for(self, candidate: int, underway: frozenset[int]) -> bool:
        activity = self.program.activities[candidate]
        left = self.old.open.get(candidate, len(activity.after))
        return left == sum(before in underway for before in activity.after)

    def _is_next(self, activity: Activity, resource: str) -> bool:
        return self.heads[resource] == self.program.places[activity.id][resource]
