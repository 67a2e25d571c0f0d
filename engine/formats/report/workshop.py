"""What an execution by physics answers, as text and as content for JSON."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from cellwright.engine.formats.report import assembling, execution
from cellwright.engine.formats.report.recovery import given_up_lines
from cellwright.engine.model.wording import counted
from cellwright.engine.pipelines.witness.touches import Touched
from cellwright.engine.pipelines.workshop.carrying import Went
from cellwright.engine.pipelines.workshop.running import Carried, Executed


def text(done: Executed) -> str:
    """An answer for people."""
    return "\n".join(["executed in MuJoCo:", *(f"  {each}" for each in _lines(done))])


def _lines(done: Executed) -> Iterator[str]:
    for run, why in zip(done.runs, (*done.refused, None), strict=False):
        yield from run.story
        if why is not None:
            yield f"the order is made anew, since {assembling.obstacle(why)}"
    for part, off in done.off.items():
        yield _stands(part, off)
    yield from _touched(done.touched)
    last = done.runs[-1]
    yield from given_up_lines(last.given_up)
    said = execution.SAID[last.outcome]
    exceptions = sum(run.exceptions for run in done.runs) - len(done.refused)
    yield f"{said}; {counted(exceptions, 'exception')}, {done.seconds:.0f} s of simulated time"


def _stands(part: str, off: tuple[float, float]) -> str:
    return f"{part} stands {1000 * off[0]:.2f} mm and {np.degrees(off[1]):.2f} degrees from its goal"


def _touched(found: Sequence[Touched]) -> Iterator[str]:
    for each in found:
        yield f"{each.first} touched {each.second} unplanned, with {each.force_n:.0f} N"


SAID = {
    Went.DONE: "{} was taken and placed",
    Went.TOUCHED: "the hand was stopped on its way to {}, and backed off",
    Went.NOT_GRIPPED: "the hand closed, and did not hold {}",
    Went.LOST: "{} was lost on the way",
    Went.BLOCKED: "{} met something before its goal",
}


def carried_text(done: Carried, part: str) -> str:
    """How one part was placed, for people."""
    lines = [SAID[done.went].format(part), _stands(part, done.off), *_touched(done.touched)]
    lines.append(f"{done.seconds:.0f} s of simulated time")
    return "\n".join(["executed in MuJoCo:", *(f"  {each}" for each in lines)])


def carried_content(done: Carried) -> dict[str, Any]:
    """How one part was placed, for JSON: metres, radians, newtons and seconds."""
    return {
        "went": done.went.value,
        "off": {"m": done.off[0], "rad": done.off[1]},
        "touched": _contacts(done.touched),
        "seconds": done.seconds,
    }


def _contacts(found: Sequence[Touched]) -> list[dict[str, Any]]:
    return [{"first": each.first, "second": each.second, "force_n": each.force_n} for each in found]


def content(done: Executed) -> dict[str, Any]:
    """An answer for JSON: metres, radians, newtons and seconds."""
    return {
        "runs": [execution.entry(run) for run in done.runs],
        "refused": [assembling.obstacle(each) for each in done.refused],
        "off": {part: {"m": metres, "rad": radians} for part, (metres, radians) in done.off.items()},
        "touched": _contacts(done.touched),
        "seconds": done.seconds,
    }
