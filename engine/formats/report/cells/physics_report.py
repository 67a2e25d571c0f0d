"""Executions in the physics simulation, as text and as data."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from cellwright.engine.formats.report.cells import assembly_report
from cellwright.engine.formats.report.runs import run_report
from cellwright.engine.formats.report.runs.recovery_report import given_up_lines
from cellwright.engine.model.noun_wording import count_noun
from cellwright.engine.pipelines.manipulation.assembly_execution import AssemblyRun, CarriedPart
from cellwright.engine.pipelines.manipulation.carry_execution import CarryEnd
from cellwright.engine.pipelines.simulators.mujoco_replay.replay_contacts import ForbiddenContact


def physics_text(done: AssemblyRun) -> str:
    """An answer for people."""
    return "\n".join(["executed in MuJoCo:", *(f"  {line}" for line in _execution_lines(done))])


def _execution_lines(done: AssemblyRun) -> Iterator[str]:
    for run, why in zip(done.runs, (*done.refused, None), strict=False):
        yield from run.story
        if why is not None:
            yield f"the order is made anew, since {assembly_report.obstacle_text(why)}"
    for part, off in done.off.items():
        yield _final_place(part, off)
    yield from _touch_lines(done.touched)
    last = done.runs[-1]
    yield from given_up_lines(last.given_up)
    end_words = run_report.ENDING_WORDS[last.outcome]
    exceptions = sum(run.exceptions for run in done.runs) - len(done.refused)
    yield (
        f"{end_words}; {count_noun(exceptions, 'exception')}, {done.seconds:.0f} s of simulated "
        "time"
    )


def _final_place(part: str, off: tuple[float, float]) -> str:
    return (
        f"{part} stands {1000 * off[0]:.2f} mm and {np.degrees(off[1]):.2f} degrees from its goal"
    )


def _touch_lines(touched_bodies: Sequence[ForbiddenContact]) -> Iterator[str]:
    for touch in touched_bodies:
        yield f"{touch.first} touched {touch.second} unplanned, with {touch.force_n:.0f} N"


PHYSICS_WORDS = {
    CarryEnd.DONE: "{} was taken and placed",
    CarryEnd.TOUCHED: "the hand was stopped on its way to {}, and backed off",
    CarryEnd.NOT_GRIPPED: "the hand closed, and did not hold {}",
    CarryEnd.LOST: "{} was lost on the way",
    CarryEnd.BLOCKED: "{} met something before its goal",
}


def carried_text(done: CarriedPart, part: str) -> str:
    """How one part was placed, for people."""
    lines = [
        PHYSICS_WORDS[done.went].format(part),
        _final_place(part, done.off),
        *_touch_lines(done.touched),
    ]
    lines.append(f"{done.seconds:.0f} s of simulated time")
    return "\n".join(["executed in MuJoCo:", *(f"  {line}" for line in lines)])


def carried_content(done: CarriedPart) -> dict[str, Any]:
    """How one part was placed, for JSON: metres, radians, newtons and seconds."""
    return {
        "went": done.went.value,
        "off": {"m": done.off[0], "rad": done.off[1]},
        "touched": _contact_entries(done.touched),
        "seconds": done.seconds,
    }


def _contact_entries(touched_bodies: Sequence[ForbiddenContact]) -> list[dict[str, Any]]:
    return [
        {"first": touch.first, "second": touch.second, "force_n": touch.force_n}
        for touch in touched_bodies
    ]


def physics_content(done: AssemblyRun) -> dict[str, Any]:
    """An answer for JSON: metres, radians, newtons and seconds."""
    return {
        "runs": [run_report.ending_entry(run) for run in done.runs],
        "refused": [
            assembly_report.obstacle_text(refused_obstacle) for refused_obstacle in done.refused
        ],
        "off": {
            part: {"m": metres, "rad": radians} for part, (metres, radians) in done.off.items()
        },
        "touched": _contact_entries(done.touched),
        "seconds": done.seconds,
    }
