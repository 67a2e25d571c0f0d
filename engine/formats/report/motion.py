"""A planned motion as text, and as content for JSON."""

import math
from collections.abc import Sequence
from typing import Any

from cellwright.engine.formats.report.motion_reasons import content_of, text_of
from cellwright.engine.model.geometry import Floats
from cellwright.engine.model.motion import Answer, Blocked, Moved, Refused
from cellwright.engine.pipelines.motion.legs import APPROACH, RETRACT, Leg
from cellwright.engine.pipelines.motion.moving import Motion

MOST = 16  # configurations of a leg that are shown
SAID = {RETRACT: "straight out", APPROACH: "straight in"}


def status(answer: Answer) -> str:
    """The status word of an answer."""
    match answer:
        case Moved():
            return "found"
        case Refused():
            return "infeasible"
        case Blocked():
            return "infeasible" if answer.severed else "gave up"


def content(motion: Motion) -> dict[str, Any]:
    """A motion for JSON: joint values (m, k) in rad and m, times in s, distances in m."""
    answer, head = motion.answer, {"arm": motion.arm}
    if not isinstance(answer, Moved):
        return {**head, **content_of(answer, motion.joints)}
    return {
        **head,
        "to": motion.goal,
        "joints": list(motion.joints),
        "path": motion.path().tolist(),
        "times_s": motion.times.corners_s().tolist(),
        "duration_s": motion.times.duration_s,
        "goal": answer.goal + 1,
        "proved": motion.proved,
        "looked": answer.looked,
        "stretches": answer.stretches,
        "refined": answer.refined,
        "legs": [_leg(leg) for leg in motion.legs],
        "slow_in": list(motion.times.slow),
    }


def _leg(leg: Leg) -> dict[str, Any]:
    touches = [
        {
            "between": [each.first, each.second],
            "deepest_m": each.deepest_m,
            "allowed_m": each.allowed_m,
            "proved": each.proved,
        }
        for each in leg.touches
    ]
    return {"kind": leg.kind, "configurations": len(leg.path), "proved": leg.proved, "touches": touches}


def text(motion: Motion) -> str:
    """A motion for people: angles in degrees, lengths in m."""
    answer = motion.answer
    if not isinstance(answer, Moved):
        return text_of(answer, motion.joints, motion.slides)
    path, times = motion.path(), motion.times.corners_s()
    said = "proved free everywhere" if motion.proved else "free where it was looked at, not proved"
    head = f"to {motion.goal}: {len(path)} configurations, {motion.times.duration_s:.2f} s, {said}"
    lines, n = [head], 0
    for leg in motion.legs:
        kind = SAID.get(leg.kind, "")
        rows = range(n + (1 if n else 0), n + len(leg.path))
        shown = [f"{times[row]:8.3f} s  {values(path[row], motion.slides)}  {kind}".rstrip() for row in rows]
        lines += (
            shown if len(shown) <= MOST else [*shown[: MOST - 2], _left_out(len(shown) - MOST + 1), shown[-1]]
        )
        n += len(leg.path) - 1
        lines += [_touch(each) for each in leg.touches]
    lines += [f"slow in {name}, because people may be there" for name in motion.times.slow]
    return "\n".join([*lines, *_rests(motion)])


def _left_out(count: int) -> str:
    return f"            and {count} more: --format json has them all"


def _rests(motion: Motion) -> list[str]:
    if len(motion.path()) < 3:
        return []
    if motion.times.cuts:
        return ["where it does not rest it cuts the corner, and passes nearest to it at the time shown"]
    return ["it rests at each configuration"]


def _touch(touch: Any) -> str:
    most = f"at most {touch.allowed_m * 1000:g} mm deep"
    if touch.proved:
        return f"            {touch.first} touches {touch.second} as declared, proved {most}"
    return (
        f"            {touch.first} goes {touch.deepest_m * 1000:.1f} mm into {touch.second}: NOT proved {most};"
        " declare `depth` at the place, or move it"
    )


def values(q: Floats, slides: Sequence[bool]) -> str:
    """The joint values (k,) of a configuration."""
    shown = zip(q, slides, strict=True)
    return ", ".join(f"{value:.3f} m" if slid else f"{math.degrees(value):.1f}" for value, slid in shown)
