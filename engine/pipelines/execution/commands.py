"""What is sent to a driver for a step."""

from engine.model.execution import Command, CommandKind
from engine.stages.execution import Activity


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
