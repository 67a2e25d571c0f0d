"""When everything in a schedule starts and ends, as tables in the order of time."""

from cellwright.engine.formats.report.rows import TextTable
from cellwright.engine.model.schedule import Schedule, Timetable
from cellwright.engine.model.shop import Shop

NUMBERS = ("end", "step")


def of_steps(made: Timetable, unit: str) -> TextTable:
    """The steps of a timetable in the order of their starts, with what they hold."""
    start = f"start ({unit})" if unit else "start"
    steps = sorted(made.plan.steps, key=lambda step: (made.starts[step.id], step.id))
    rows = [
        (
            str(made.starts[step.id]),
            str(made.starts[step.id] + step.duration),
            str(step.id),
            str(step.operator),
            ", ".join(map(str, step.resources)),
        )
        for step in steps
    ]
    return TextTable((start, "end", "step", "operator", "holds"), rows, right=(start, *NUMBERS))


def of_stages(shop: Shop, schedule: Schedule, unit: str = "") -> TextTable:
    """The stages of a shop and the changes of its devices in the order of their starts."""
    start = f"start ({unit})" if unit else "start"
    found = [
        (
            schedule.starts[name],
            schedule.starts[name] + stage.duration,
            shop.owners[name].name,
            name.removeprefix(shop.owners[name].name).strip(" .:") or name,
            ", ".join(stage.resources),
        )
        for name, stage in shop.stages.items()
    ]
    found += [
        (each.start, each.end, "", f"{each.device} to {each.change.after}", "")
        for each in schedule.adjustments
    ]
    rows = [(str(begin), str(end), *rest) for begin, end, *rest in sorted(found)]
    return TextTable((start, "end", "job", "stage", "on"), rows, right=(start, *NUMBERS))
