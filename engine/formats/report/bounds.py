"""What bounds the makespan of a plan, in words and for programs."""

from typing import Any

from cellwright.engine.model.bottleneck import Bottleneck, bottleneck
from cellwright.engine.model.schedule import Timetable
from cellwright.engine.model.wording import counted


def bounds(found: Bottleneck, unit: str) -> str:
    """What bounds a makespan, in words: the resource that never rests or the chain of steps, and their parts."""
    parts = [f"{each.operator} {each.time} {unit} ({counted(each.steps, 'step')})" for each in found.shares]
    parts += [f"waiting and ways between {found.waiting} {unit}"] if found.waiting else []
    if not parts:
        return "No step takes any time."
    what = f"{found.resource} never rests" if found.resource else "A chain of steps bounds it"
    return f"{what}: {', '.join(parts)}."


def bottleneck_entry(made: Timetable) -> dict[str, Any]:
    """What bounds the makespan of a timetable, for programs: a resource that never rests, or a chain of steps."""
    found = bottleneck(made.plan, made.starts)
    return {
        "resource": None if found.resource is None else str(found.resource),
        "waiting": found.waiting,
        "parts": [{"operator": s.operator, "steps": s.steps, "time": s.time} for s in found.shares],
    }
