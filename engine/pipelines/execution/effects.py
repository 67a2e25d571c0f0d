"""What the executive wants done is done here: commands are posted, the world model follows, a driver is brought to rest."""

from typing import TYPE_CHECKING

from engine.model.execution import Command, CommandKind, Phase, RecordKind, Reply
from engine.pipelines.simulation.world import achievement
from engine.stages import execution as executive

if TYPE_CHECKING:
    from engine.pipelines.execution.course import Course

QUIET_MS = 1_000  # a driver may take so long to drop what is queued
NOTICED_MS = (
    30_000  # by which a step may end later or sooner than it was forecast, before the plan is looked at again
)
OTHERWISE = "steps take longer or less than was forecast"
VERDICT = ("of", "quantity", "value", "unit", "nominal", "lower", "upper", "passed", "tool")


def dispatch(course: "Course", sent: executive.Dispatch) -> None:
    """Post the command of an activity, a WAIT or a CONTINUE."""
    if sent.activity is None:
        kind = CommandKind.WAIT if sent.about is None else CommandKind.CONTINUE
        course.post(Command(sent.number, kind, sent.stream, kind.value, about=sent.about))
        return
    each = course.compiled.program.activities[sent.activity]
    command = Command(
        sent.number,
        CommandKind.STEP,
        each.stream,
        each.action,
        each.says,
        each.expects,
        lasts_ms=each.lasts_ms,
        timeout_ms=each.timeout_ms,
        asks=each.asks,
    )
    course.post(command, each.id)


def done(course: "Course", ended: executive.Done) -> None:
    """Let the world model follow a step that has ended, and note what it has changed."""
    activity, change = ended.activity, course.compiled.changes[ended.activity]
    new = [atom for atom in (*change.adds, *change.events) if atom not in course.world.facts]
    moved = course.world.apply(change)
    course.done.add(activity)
    if course.compiled.program.timed:
        course.since.update(dict.fromkeys(new, course.standing.now_ms))
    _look_at_the_forecast(course, activity)
    course.sent.pop(ended.number, None)
    if course.keeps_history:
        step = course.replies.step(activity)
        course.history.append(achievement(len(course.history) + 1, step, new, moved))
    course.recorder.note(
        RecordKind.DONE,
        step=activity,
        command=ended.number,
        action=course.compiled.program.activities[activity].action,
        started_ms=ended.started_ms,
        adds=[str(each) for each in change.adds],
        ends=[str(each) for each in change.ends],
        events=[str(each) for each in change.events],
        moved=[[chain, number, str(atom)] for chain, number, atom in moved],
    )
    for chain, _, atom in moved:
        course.recorder.note(RecordKind.GOAL, goal=f"{atom} of {chain}")


def _look_at_the_forecast(course: "Course", activity: int) -> None:
    """Ask for a review of the plan if this step has ended much later, or sooner, than it was forecast to."""
    each = course.compiled.program.activities[activity]
    off = course.standing.now_ms - (each.start_ms + each.lasts_ms)
    if abs(off - course.off_ms) >= max(NOTICED_MS, each.lasts_ms // 10):
        course.off_ms, course.review = off, course.review or OTHERWISE


def result(course: "Course", activity: int, reply: Reply) -> None:
    """Note the fact that a reply gives, and the value that was measured with its verdict."""
    said, step = course.replies.result(activity, reply.text), course.replies.step(activity)
    found = course.measuring.heard(step, reply.text, reply.at_ms) if course.measuring is not None else None
    if said is None and found is None:
        return
    verdict = {} if found is None else {name: getattr(found, name) for name in VERDICT}
    action = course.compiled.program.activities[activity].action
    fact = "" if said is None else str(said)
    course.recorder.note(RecordKind.RESULT, command=reply.number, action=action, result=fact, **verdict)


def quiesce(course: "Course") -> None:
    """Have the driver begin nothing more, and take in what came meanwhile."""
    course.recorder.note(RecordKind.PHASE, phase=Phase.QUIESCING.value, why="a step has failed")
    course.flush()
    came = course.driver.quiesce(QUIET_MS)
    reports = course.driver.report(sorted(course.standing.running))
    dropped = [each.number for each in reports if each.fate.value in ("dropped", "unknown")]
    if dropped:
        course.take(executive.Withdrawn(tuple(dropped)))
    for message in came:
        course.hear(message)


def threatened(course: "Course", threat: executive.Threatened) -> None:
    """Tell that something stays too long, or will."""
    target = course.compiled.program.activities[threat.dwell.target]
    said = "it stays too long" if threat.over else "as things stand, it will stay too long"
    course.recorder.note(
        RecordKind.EXCEPTION,
        exception="stays_too_long",
        known=True,
        step=threat.dwell.target,
        action=target.action,
        command=None,
        reply=f"{said}: by {round(threat.late_ms / 1000, 3)} s at least",
    )
