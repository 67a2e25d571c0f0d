"""The transition table of the executive: for each phase and event, what comes of it."""

from collections.abc import Callable, Mapping
from dataclasses import replace

from cellwright.engine.model.execution import Phase
from cellwright.engine.stages.execution import events as e
from cellwright.engine.stages.execution.dispatch import dispatched
from cellwright.engine.stages.execution.estimate import soonest
from cellwright.engine.stages.execution.program import Program
from cellwright.engine.stages.execution.standing import Running, Standing, deadline, unrested_after

Step = tuple[Standing, tuple[e.Effect, ...]]
TIMEOUT = "timeout"


def advance(program: Program, standing: Standing, event: e.Event, now_ms: int) -> Step:
    """What an event leads to at a time of the run's clock: the next standing, and what is to be done, in order."""
    move = TABLE.get((standing.phase, type(event)), _ignored)
    return move(program, standing if standing.now_ms == now_ms else replace(standing, now_ms=now_ms), event)


def next_time(program: Program, standing: Standing) -> int | None:
    """When something is due even if no reply comes: a timeout, a forecast start, the end of a wait. None if nothing is."""
    now, times = standing.now_ms, list[int]()
    for running in standing.running.values():
        due = deadline(program.activities[running.activity], running.since_ms)
        times += [due] if due is not None else []
        times += (
            [running.since_ms + program.activities[running.activity].lasts_ms + 1]
            if standing.dwelling
            else []
        )
    if standing.phase in (Phase.RUNNING, Phase.INTERRUPTING) and program.timed and not standing.frozen:
        times += [program.activities[each].start_ms for each in standing.ready]
    times += [moment for when in standing.dwelling.values() for moment in (when, when + 1)]
    return min((each for each in times if each > now), default=None)


def waits(program: Program, standing: Standing) -> bool:
    """Whether nothing can begin before something ends that goes on without a hand, though something is left to begin."""
    left = len(program.activities) - standing.done - len(standing.running)
    return bool(left and standing.running) and _is_still(program, standing)


def _ignored(_program: Program, standing: Standing, _event: e.Event) -> Step:
    return standing, ()


def _began(program: Program, standing: Standing, _event: e.Event) -> Step:
    return _going_on(program, replace(standing, phase=Phase.RUNNING, frozen=False))


def _going_on(program: Program, standing: Standing) -> Step:
    """Begin what can begin, look after what waits, and see whether everything has ended."""
    standing, sent = dispatched(program, standing)
    standing, threats = _watched(program, standing)
    if standing.finished(program) and not standing.running:
        return replace(standing, phase=Phase.FINISHED), (*sent, *threats, e.Completed())
    if standing.phase is Phase.INTERRUPTING and standing.frozen and _is_still(program, standing):
        return replace(standing, phase=Phase.PAUSED), (*sent, *threats, e.Paused())
    return standing, (*sent, *threats)


def _is_still(program: Program, standing: Standing) -> bool:
    return all(program.activities[each.activity].process for each in standing.running.values())


def _watched(program: Program, standing: Standing) -> tuple[Standing, tuple[e.Threatened, ...]]:
    """The waits that will last too long as things stand, and those that have; each is told once as such."""
    if not standing.dwelling:
        return standing, ()
    begun = {each.activity for each in standing.running.values()}
    dwelling = {dwell: until for dwell, until in standing.dwelling.items() if dwell.target not in begun}
    ends = {r.activity: _end(program, r, standing.now_ms) for r in standing.running.values()}
    found = []
    for dwell, until in dwelling.items():
        over = standing.now_ms > until
        late = soonest(program, ends, standing.ready, standing.now_ms, dwell.target) - until
        if late > 0 and (dwell, over) not in standing.warned:
            found.append(e.Threatened(dwell, late, over))
    warned = standing.warned.union((threat.dwell, threat.over) for threat in found)
    return replace(standing, dwelling=dwelling, warned=warned), tuple(found)


def _end(program: Program, running: Running, now_ms: int) -> int:
    """When an activity that is under way will end; one that is late takes a tenth longer than it has, from now on."""
    lasts = program.activities[running.activity].lasts_ms
    end = running.since_ms + lasts
    return end if end > now_ms else now_ms + max(1, (now_ms - running.since_ms) // 10)


def _replied(program: Program, standing: Standing, event: e.Event) -> Step:
    assert isinstance(event, e.Replied)
    if event.number not in standing.running:
        return standing, ()
    running = standing.running[event.number]
    standing = _ended(program, standing, event.number)
    standing, released = _released(standing)
    done = e.Done(running.activity, event.number, running.since_ms)
    if standing.phase is Phase.INTERRUPTING and not standing.unrested:
        standing = replace(standing, frozen=True)
    if standing.phase in (Phase.RUNNING, Phase.INTERRUPTING):
        standing, more = _going_on(program, standing)
        return standing, (done, *released, *more)
    if standing.phase is Phase.QUIESCING:
        standing, more = _quiet(program, standing)
        return standing, (done, *more)
    return standing, (done,)


def _released(standing: Standing) -> tuple[Standing, tuple[e.Dispatch, ...]]:
    """Continue the WAITs whose activities have ended."""
    under_way = {each.activity for each in standing.running.values()}
    over = [number for number, (_, awaited) in standing.waits.items() if not awaited & under_way]
    if not over:
        return standing, ()
    sent = tuple(
        e.Dispatch(standing.number + n, None, standing.waits[number][0], number)
        for n, number in enumerate(over)
    )
    waits = {number: wait for number, wait in standing.waits.items() if number not in over}
    return replace(standing, waits=waits, number=standing.number + len(over)), sent


def _ended(program: Program, standing: Standing, number: int) -> Standing:
    """The standing after a command has done what it should."""
    activity_id = standing.running[number].activity
    activity = program.activities[activity_id]
    ready, partly, left_running = (
        set(standing.ready),
        dict(standing.open),
        _without(program, standing, number),
    )
    begun = {each.activity for each in left_running.values()}
    for later in program.successors[activity_id]:
        if later in begun:
            continue
        left = partly.pop(later, len(program.activities[later].after)) - 1
        if left:
            partly[later] = left
        else:
            ready.add(later)
    dwelling = {dwell: until for dwell, until in standing.dwelling.items() if dwell.target not in begun}
    dwelling |= {dwell: standing.now_ms + dwell.most_ms for dwell in program.ending_in.get(activity_id, ())}
    return replace(
        standing,
        running=left_running,
        busy=_released_by(standing, activity_id),
        ready=frozenset(ready),
        open=partly,
        unrested=unrested_after(standing.unrested, activity, program.hands),
        dwelling=dwelling,
        done=standing.done + 1,
    )


def _without(program: Program, standing: Standing, number: int) -> dict[int, Running]:
    """What is under way without a command. The next of its stream begins now."""
    running = dict(standing.running)
    activity = running.pop(number).activity
    stream = program.activities[activity].stream
    if program.lookahead.get(stream, 1) > 1:
        following = (n for n, r in sorted(running.items()) if program.activities[r.activity].stream == stream)
        if (following_number := next(following, None)) is not None:
            running[following_number] = Running(running[following_number].activity, standing.now_ms)
    return running


def _released_by(standing: Standing, activity: int) -> dict[str, int]:
    """Who holds which resource when an activity does not any more."""
    return {resource: each for resource, each in standing.busy.items() if each != activity}


def _taken_back(program: Program, standing: Standing, number: int) -> Standing:
    """The standing without a command; its activity has not ended."""
    activity = standing.running[number].activity
    running = _without(program, standing, number)
    return replace(standing, running=running, busy=_released_by(standing, activity))


def _failed(program: Program, standing: Standing, event: e.Event) -> Step:
    assert isinstance(event, e.Failed)
    if event.number not in standing.running:
        return standing, ()
    return _given_up(program, standing, {event.number: event.reply})


def _given_up(program: Program, standing: Standing, failed: Mapping[int, str]) -> Step:
    """The step from failures to quiet. An activity that failed is neither done nor ready."""
    failures = list(standing.failures)
    for number, reply in failed.items():
        running = standing.running[number]
        standing = _taken_back(program, standing, number)
        failures.append(e.Failure(running.activity, number, reply, running.since_ms))
    first = standing.phase is not Phase.QUIESCING
    standing = replace(standing, failures=tuple(failures), phase=Phase.QUIESCING)
    standing, more = _quiet(program, standing)
    return standing, ((e.Quiesce(), *more) if first else more)


def _quiet(_program: Program, standing: Standing) -> Step:
    if standing.running:
        return standing, ()
    return replace(standing, phase=Phase.HANDLING), (e.Handle(standing.failures),)


def _passed(program: Program, standing: Standing, _event: e.Event) -> Step:
    late = {}
    for number, running in standing.running.items():
        due = deadline(program.activities[running.activity], running.since_ms)
        if due is not None and due <= standing.now_ms and _is_first(program, standing, number):
            late[number] = TIMEOUT
    if late:
        return _given_up(program, standing, late)
    if standing.phase in (Phase.RUNNING, Phase.INTERRUPTING):
        return _going_on(program, standing)
    return standing, ()


def _is_first(program: Program, standing: Standing, number: int) -> bool:
    """Whether a command is the one that its device is at."""
    stream = program.activities[standing.running[number].activity].stream
    if program.lookahead.get(stream, 1) < 2:
        return True
    if any(
        awaited and wait < number and where == stream for wait, (where, awaited) in standing.waits.items()
    ):
        return False
    return all(
        other >= number or program.activities[r.activity].stream != stream
        for other, r in standing.running.items()
    )


def _withdrawn(program: Program, standing: Standing, event: e.Event) -> Step:
    """Commands that were taken back can be given again; what was queued ahead waits for its predecessors as before."""
    assert isinstance(event, e.Withdrawn)
    for number in (each for each in event.numbers if each in standing.running):
        standing = _taken_back(program, standing, number)
    standing = replace(standing, waits={})
    return _quiet(program, standing) if standing.phase is Phase.QUIESCING else (standing, ())


def _interrupted(program: Program, standing: Standing, _event: e.Event) -> Step:
    standing = replace(
        standing, phase=Phase.INTERRUPTING, frozen=not standing.unrested and not _handed(program, standing)
    )
    return _going_on(program, standing)


def _handed(program: Program, standing: Standing) -> bool:
    """Whether an activity is under way that needs a hand."""
    return not _is_still(program, standing)


def _stopped(_program: Program, standing: Standing, _event: e.Event) -> Step:
    return replace(standing, phase=Phase.STOPPED), (e.Halt(),)


Move = Callable[[Program, Standing, e.Event], Step]
ACTIVE = (Phase.RUNNING, Phase.INTERRUPTING, Phase.QUIESCING, Phase.PAUSED)
TABLE: Mapping[tuple[Phase, type[e.Event]], Move] = {
    (Phase.READY, e.Began): _began,
    **{(phase, e.Replied): _replied for phase in ACTIVE},
    **{(phase, e.Failed): _failed for phase in ACTIVE},
    **{(phase, e.Passed): _passed for phase in ACTIVE},
    **{(phase, e.Withdrawn): _withdrawn for phase in ACTIVE},
    (Phase.READY, e.Interrupted): _interrupted,
    (Phase.RUNNING, e.Interrupted): _interrupted,
    (Phase.INTERRUPTING, e.Continued): _began,
    (Phase.PAUSED, e.Continued): _began,
    **{(phase, e.Stopped): _stopped for phase in (*ACTIVE, Phase.READY, Phase.HANDLING)},
}
