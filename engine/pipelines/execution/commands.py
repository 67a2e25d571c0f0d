"""What is sent to a driver for a step, and for a test, a repair or a question of a diagnosis."""

from collections.abc import Sequence
from fractions import Fraction

from cellwright.engine.model.execution import Command, CommandKind
from cellwright.engine.pipelines.execution.compiling import GRACE_MS, PATIENCE
from cellwright.engine.pipelines.troubleshooting import Desk
from cellwright.engine.stages.execution import Activity


def command_of(number: int, activity: Activity) -> Command:
    """The command with which an activity begins."""
    return Command(
        number,
        CommandKind.STEP,
        activity.stream,
        activity.action,
        activity.says,
        activity.expects,
        lasts_ms=activity.lasts_ms,
        timeout_ms=activity.timeout_ms,
        asks=activity.asks,
        looks=activity.looks,
        watches=activity.watches,
    )


def asking(desk: Desk, name: str, outcomes: Sequence[str], unit: Fraction) -> Command:
    """The command for a test or a repair of a case, or for the question to a person; a unit of costs is so many ms."""
    model = desk.model
    found = model.tests.get(name) or model.repairs.get(name)
    lasts = int((found.duration or found.cost if found is not None else model.stop) * unit)
    kind = CommandKind.ASK
    if found is not None:
        kind = CommandKind.TEST if name in model.tests else CommandKind.REPAIR
    asks = kind is CommandKind.ASK or (found is not None and found.asks)
    says = desk.says(name) if found is not None else desk.session.diagnosis().question_text
    stream = "person" if asks else "cell"
    timeout = PATIENCE * lasts + GRACE_MS
    return Command(0, kind, stream, name, says, "", tuple(outcomes), lasts, timeout, asks=asks)
