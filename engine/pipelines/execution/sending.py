"""A run with motion looks at each step before it is sent. In a run without motion, which has no paths, nothing of this happens."""

from collections.abc import Collection
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from cellwright.engine.pipelines.execution.compiling import Compiled
from cellwright.engine.pipelines.execution.records import read_atom
from cellwright.engine.stages.execution import Activity, Standing
from cellwright.engine.stages.macros.lifted.world import StepChange
from cellwright.kb.terms import Atom

if TYPE_CHECKING:
    from cellwright.engine.pipelines.execution.paths import Paths


def refusal(
    paths: "Paths | None",
    facts: Collection[Atom],
    compiled: Compiled,
    standing: Standing,
    number: int,
    each: Activity,
) -> str:
    """Why a step has no motion in the cell as it is believed to be, as the command of that number; empty if it has one.

    The commands that are before it in the queue of its device will have ended.
    """
    if paths is None:
        return ""
    before = frozenset(facts)
    for _, running in sorted(standing.running.items()):
        other = compiled.program.activities[running.activity]
        if other.stream == each.stream and other.id != each.id:
            before = _after(before, compiled.changes[other.id])
    return paths.refusal(number, read_atom(each.action), before, _after(before, compiled.changes[each.id]))


def lasting(paths: "Paths | None", number: int, each: Activity) -> Activity:
    """A step that was looked at as the command of that number, with the time of its motion in place of the forecast."""
    lasts = paths.lasts_ms(number) if paths is not None else None
    return each if lasts is None else replace(each, lasts_ms=lasts)


def _after(facts: frozenset[Atom], change: StepChange) -> frozenset[Atom]:
    return (facts - frozenset(change.ends)) | frozenset(change.adds)


def arms(paths: "Paths | None", number: int) -> dict[str, Any]:
    """Where the arms are that a step has moved, as its record has it."""
    found = paths.done(number) if paths is not None else {}
    return {"arms": found} if found else {}
