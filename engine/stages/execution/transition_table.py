"""The executive's transition table: for each phase and event, the next state."""

from collections.abc import Callable, Mapping
from dataclasses import replace

from cellwright.engine.model.run_protocol import RunPhase
from cellwright.engine.stages.execution import run_events as e
from cellwright.engine.stages.execution.activity_program import ActivityProgram
from cellwright.engine.stages.execution.dispatch import dispatch_activities, soonest_start
from cellwright.engine.stages.execution.rule_following import allowed_start, is_within_ranges
from cellwright.engine.stages.execution.run_state import (
    ExecutiveState,
    Running,
    reply_deadline,
    unrested_after,
)

NextStanding = tuple[ExecutiveState, tuple[e.Effect, ...]]
TIMEOUT_REPLY = "timeout"


def advance_run(
    program: ActivityProgram, standing: ExecutiveState, event: e.Event, now_ms: int
) -> NextStanding:
    """What an event leads to at a time of the run's clock: the next standing, and what is to be
    done, in order.
    """
    move = TRANSITIONS.get((standing.phase, type(event)), _ignore_event)
    return move(
        program, standing if standing.now_ms == now_ms else replace(standing, now_ms=now_ms), event
    )


def next_time(program: ActivityProgram, standing: ExecutiveState) -> int | None:
    """When something is due even if no reply comes: a timeout, a forecast start, the end of a wait.

    None if nothing is.
    """
    now, times = standing.now_ms, list[int]()
    for running in standing.running.values():
        due = reply_deadline(program.activities[running.activity], running.since_ms)
        times += [due] if due is not None else []
        times += (
            [running.since_ms + program.activities[running.activity].lasts_ms + 1]
            if standing.dwelling
            else []
        )
    if (
        standing.phase in (RunPhase.RUNNING, RunPhase.INTERRUPTING)
        and program.timed
        and not standing.frozen
    ):
        times += [program.activities[ready_activity].start_ms for ready_activity in standing.ready]
    if program.follows_rules and standing.phase in (RunPhase.RUNNING, RunPhase.INTERRUPTING):
        times += _allowed_starts(program, standing)
    times += [moment for when in standing.dwelling.values() for moment in (when, when + 1)]
    return min((start_time for start_time in times if start_time > now), default=None)


def _allowed_starts(program: ActivityProgram, standing: ExecutiveState) -> list[int]:
    """When the rules of what is ready allow it to begin, as far as that is known."""
    rules = (program.activities[activity].rule for activity in standing.ready)
    starts = (allowed_start(program, standing, rule) for rule in rules if rule is not None)
    return [start for start in starts if start is not None]


def only_waits(program: ActivityProgram, standing: ExecutiveState) -> bool:
    """Whether nothing can begin before something ends that goes on without a hand, though
    something is left to begin.
    """
    left = len(program.activities) - standing.done - len(standing.running)
    return bool(left and standing.running) and _is_still(program, standing)


def _ignore_event(
    _program: ActivityProgram, standing: ExecutiveState, _event: e.Event
) -> NextStanding:
    return standing, ()


def _on_began(program: ActivityProgram, standing: ExecutiveState, _event: e.Event) -> NextStanding:
    return _going_on(program, replace(standing, phase=RunPhase.RUNNING, frozen=False))


def _going_on(program: ActivityProgram, standing: ExecutiveState) -> NextStanding:
    """Begin what can begin, look after what waits, and see whether everything has ended."""
    standing, sent = dispatch_activities(program, standing)
    standing, threats = _watch_dwells(program, standing)
    if standing.finished(program) and not standing.running:
        return replace(standing, phase=RunPhase.FINISHED), (*sent, *threats, e.Completed())
    if standing.phase is RunPhase.INTERRUPTING and standing.frozen and _is_still(program, standing):
        return replace(standing, phase=RunPhase.PAUSED), (*sent, *threats, e.Paused())
    return standing, (*sent, *threats)


def _is_still(program: ActivityProgram, standing: ExecutiveState) -> bool:
    return all(
        program.activities[running.activity].process for running in standing.running.values()
    )


def _watch_dwells(
    program: ActivityProgram, standing: ExecutiveState
) -> tuple[ExecutiveState, tuple[e.Threatened, ...]]:
    """The waits that will last too long as things stand, and those that have; each is told once
    as such.
    """
    if not standing.dwelling:
        return standing, ()
    begun = {running.activity for running in standing.running.values()}
    dwelling = {
        dwell: until for dwell, until in standing.dwelling.items() if dwell.target not in begun
    }
    ends = {
        r.activity: _expected_end(program, r, standing.now_ms) for r in standing.running.values()
    }
    threats, sure = [], is_within_ranges(program, standing)
    for dwell, until in dwelling.items():
        over = standing.now_ms > until
        if sure and not over:
            continue
        late = soonest_start(program, ends, standing.ready, standing.now_ms, dwell.target) - until
        if late > 0 and (dwell, over) not in standing.warned:
            threats.append(e.Threatened(dwell, late, over))
    warned = standing.warned.union((threat.dwell, threat.over) for threat in threats)
    return replace(standing, dwelling=dwelling, warned=warned), tuple(threats)


def _expected_end(program: ActivityProgram, running: Running, now_ms: int) -> int:
    """When an activity that is under way will end; one that is late takes a tenth longer than
    it has, from now on.
    """
    lasts = program.activities[running.activity].lasts_ms
    end = running.since_ms + lasts
    return end if end > now_ms else now_ms + max(1, (now_ms - running.since_ms) // 10)


def _on_replied(program: ActivityProgram, standing: ExecutiveState, event: e.Event) -> NextStanding:
    assert isinstance(event, e.Replied)
    if event.number not in standing.running:
        return standing, ()
    running = standing.running[event.number]
    standing = _end_command(program, standing, event.number)
    standing, released = _release_waits(standing)
    done = e.Done(running.activity, event.number, running.since_ms)
    if standing.phase is RunPhase.INTERRUPTING and not standing.unrested:
        standing = replace(standing, frozen=True)
    if standing.phase in (RunPhase.RUNNING, RunPhase.INTERRUPTING):
        standing, more = _going_on(program, standing)
        return standing, (done, *released, *more)
    if standing.phase is RunPhase.QUIESCING:
        standing, more = _quieten_run(program, standing)
        return standing, (done, *more)
    return standing, (done,)


def _release_waits(standing: ExecutiveState) -> tuple[ExecutiveState, tuple[e.Dispatch, ...]]:
    """Continue the WAITs whose activities have ended."""
    under_way = {running.activity for running in standing.running.values()}
    over = [number for number, (_, awaited) in standing.waits.items() if not awaited & under_way]
    if not over:
        return standing, ()
    sent = tuple(
        e.Dispatch(standing.number + n, None, standing.waits[number][0], number)
        for n, number in enumerate(over)
    )
    waits = {number: wait for number, wait in standing.waits.items() if number not in over}
    return replace(standing, waits=waits, number=standing.number + len(over)), sent


def _end_command(program: ActivityProgram, standing: ExecutiveState, number: int) -> ExecutiveState:
    """The standing after a command has done what it should."""
    activity_id = standing.running[number].activity
    activity = program.activities[activity_id]
    ready, partly, left_running = (
        set(standing.ready),
        dict(standing.open),
        _running_without(program, standing, number),
    )
    begun = {still_running.activity for still_running in left_running.values()}
    for later in program.successors[activity_id]:
        if later in begun:
            continue
        left = partly.pop(later, len(program.activities[later].after)) - 1
        if left:
            partly[later] = left
        else:
            ready.add(later)
    dwelling = {
        dwell: until for dwell, until in standing.dwelling.items() if dwell.target not in begun
    }
    dwelling |= {
        dwell: standing.now_ms + dwell.most_ms for dwell in program.ending_in.get(activity_id, ())
    }
    return replace(
        standing,
        running=left_running,
        busy=_released_by(standing, activity_id),
        ready=frozenset(ready),
        open=partly,
        unrested=unrested_after(standing.unrested, activity, program.hands),
        dwelling=dwelling,
        done=standing.done + 1,
        ended_ms={**standing.ended_ms, activity_id: standing.now_ms}
        if program.follows_rules
        else standing.ended_ms,
    )


def _running_without(
    program: ActivityProgram, standing: ExecutiveState, number: int
) -> dict[int, Running]:
    """What is under way without a command. The next of its stream begins now."""
    running = dict(standing.running)
    activity = running.pop(number).activity
    stream = program.activities[activity].stream
    if program.lookahead.get(stream, 1) > 1:
        following = (
            n for n, r in sorted(running.items()) if program.activities[r.activity].stream == stream
        )
        if (following_number := next(following, None)) is not None:
            running[following_number] = Running(running[following_number].activity, standing.now_ms)
    return running


def _released_by(standing: ExecutiveState, activity: int) -> dict[str, int]:
    """Who holds which resource when an activity does not any more."""
    return {resource: holder for resource, holder in standing.busy.items() if holder != activity}


def _taken_back(program: ActivityProgram, standing: ExecutiveState, number: int) -> ExecutiveState:
    """The standing without a command; its activity has not ended."""
    activity = standing.running[number].activity
    running = _running_without(program, standing, number)
    return replace(standing, running=running, busy=_released_by(standing, activity))


def _on_failed(program: ActivityProgram, standing: ExecutiveState, event: e.Event) -> NextStanding:
    assert isinstance(event, e.CommandFailed)
    if event.number not in standing.running:
        return standing, ()
    return _given_up(program, standing, {event.number: event.reply})


def _given_up(
    program: ActivityProgram, standing: ExecutiveState, failed: Mapping[int, str]
) -> NextStanding:
    """The step from failures to quiet. An activity that failed is neither done nor ready."""
    failures = list(standing.failures)
    for number, reply in failed.items():
        running = standing.running[number]
        standing = _taken_back(program, standing, number)
        failures.append(e.Failure(running.activity, number, reply, running.since_ms))
    first = standing.phase is not RunPhase.QUIESCING
    standing = replace(standing, failures=tuple(failures), phase=RunPhase.QUIESCING)
    standing, more = _quieten_run(program, standing)
    return standing, ((e.Quiesce(), *more) if first else more)


def _quieten_run(_program: ActivityProgram, standing: ExecutiveState) -> NextStanding:
    if standing.running:
        return standing, ()
    return replace(standing, phase=RunPhase.HANDLING), (e.Handle(standing.failures),)


def _on_time_passed(
    program: ActivityProgram, standing: ExecutiveState, _event: e.Event
) -> NextStanding:
    late = {}
    for number, running in standing.running.items():
        due = reply_deadline(program.activities[running.activity], running.since_ms)
        if due is not None and due <= standing.now_ms and _is_first(program, standing, number):
            late[number] = TIMEOUT_REPLY
    if late:
        return _given_up(program, standing, late)
    if standing.phase in (RunPhase.RUNNING, RunPhase.INTERRUPTING):
        return _going_on(program, standing)
    return standing, ()


def _is_first(program: ActivityProgram, standing: ExecutiveState, number: int) -> bool:
    """Whether a command is the one that its device is at."""
    stream = program.activities[standing.running[number].activity].stream
    if program.lookahead.get(stream, 1) < 2:
        return True
    if any(
        awaited and wait < number and where == stream
        for wait, (where, awaited) in standing.waits.items()
    ):
        return False
    return all(
        other >= number or program.activities[r.activity].stream != stream
        for other, r in standing.running.items()
    )


def _on_withdrawn(
    program: ActivityProgram, standing: ExecutiveState, event: e.Event
) -> NextStanding:
    """Commands that were taken back can be given again; what was queued ahead waits for its
    predecessors as before.
    """
    assert isinstance(event, e.Withdrawn)
    for number in (
        command_number for command_number in event.numbers if command_number in standing.running
    ):
        standing = _taken_back(program, standing, number)
    standing = replace(standing, waits={})
    return (
        _quieten_run(program, standing) if standing.phase is RunPhase.QUIESCING else (standing, ())
    )


def _on_interrupted(
    program: ActivityProgram, standing: ExecutiveState, _event: e.Event
) -> NextStanding:
    standing = replace(
        standing,
        phase=RunPhase.INTERRUPTING,
        frozen=not standing.unrested and not _needs_hand(program, standing),
    )
    return _going_on(program, standing)


def _needs_hand(program: ActivityProgram, standing: ExecutiveState) -> bool:
    """Whether an activity is under way that needs a hand."""
    return not _is_still(program, standing)


def _on_stopped(
    _program: ActivityProgram, standing: ExecutiveState, _event: e.Event
) -> NextStanding:
    return replace(standing, phase=RunPhase.STOPPED), (e.Halt(),)


TransitionRule = Callable[[ActivityProgram, ExecutiveState, e.Event], NextStanding]
ACTIVE_PHASES = (RunPhase.RUNNING, RunPhase.INTERRUPTING, RunPhase.QUIESCING, RunPhase.PAUSED)
TRANSITIONS: Mapping[tuple[RunPhase, type[e.Event]], TransitionRule] = {
    (RunPhase.READY, e.Began): _on_began,
    **{(phase, e.Replied): _on_replied for phase in ACTIVE_PHASES},
    **{(phase, e.CommandFailed): _on_failed for phase in ACTIVE_PHASES},
    **{(phase, e.TimePassed): _on_time_passed for phase in ACTIVE_PHASES},
    **{(phase, e.Withdrawn): _on_withdrawn for phase in ACTIVE_PHASES},
    (RunPhase.READY, e.Interrupted): _on_interrupted,
    (RunPhase.RUNNING, e.Interrupted): _on_interrupted,
    (RunPhase.INTERRUPTING, e.Continued): _on_began,
    (RunPhase.PAUSED, e.Continued): _on_began,
    **{
        (phase, e.StopCommanded): _on_stopped
        for phase in (*ACTIVE_PHASES, RunPhase.READY, RunPhase.HANDLING)
    },
}
