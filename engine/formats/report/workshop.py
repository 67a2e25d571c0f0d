"""What an execution by physics answers, as text and as content for JSON."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from engine.formats.report import assembling, execution
from engine.formats.report.recovery import given_up_lines
from engine.model.wording import counted
from engine.pipelines.workshop.running import Executed


def text(done: Executed) -> str:
    """An answer for people."""
    return "\n".join(["executed in MuJoCo:", *(f"  {each}" for each in _lines(done))])


def _lines(done: Executed) -> Iterator[str]:
    for run, why in zip(done.runs, (*done.refused, None), strict=False):
        yield from run.story
        if why is not None:
            yield f"the order is made anew, since {assembling.obstacle(why)}"
    for part, (metres, radians) in done.off.items():
        yield f"{part} stands {1000 * metres:.2f} mm and {np.degrees(radians):.2f} degrees from its goal"
    for each in done.touched:
        yield f"{each.first} touched {each.second} unplanned, with {each.force_n:.0f} N"
    last = done.runs[-1]
    yield from given_up_lines(last.given_up)
    said = execution.SAID[last.outcome]
    exceptions = sum(run.exceptions for run in done.runs) - len(done.refused)
    yield f"{said}; {counted(exceptions, 'exception')}, {done.seconds:.0f} s of simulated time"


def content(done: Executed) -> dict[str, Any]:
    """An answer for JSON: metres, radians, newtons and seconds."""
    return {
        "runs": [execution.entry(run) for run in done.runs],
        "refused": [assembling.obstacle(each) for each in done.refused],
        "off": {part: {"m": metres, "rad": radians} for part, (metres, radians) in done.off.items()},
        "touched": [
            {"first": each.first, "second": each.second, "force_n": each.force_n} for each in done.touched
        ],
        "seconds": done.seconds,
    }
