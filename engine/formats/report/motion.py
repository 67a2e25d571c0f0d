"""A planned motion as text, and as content for JSON."""

import math
from collections.abc import Sequence
from typing import Any

from engine.model.geometry import Contact, Floats
from engine.model.motion import Answer, Blocked, InCollision, Moved, OutsideLimits, Reason, Refused

SHOWN = 3  # contacts that are named


def status(answer: Answer) -> str:
    """The status word of an answer."""
    match answer:
        case Moved():
            return "found"
        case Refused():
            return "infeasible"
        case Blocked():
            return "gave up"


def content(answer: Answer, joints: Sequence[str], path: Floats, times: Floats) -> dict[str, Any]:
    """An answer for JSON: joint values (m, k) in rad and m, times (m,) in s, distances in m."""
    match answer:
        case Moved():
            return {
                "joints": list(joints),
                "path": path.tolist(),
                "times_s": times.tolist(),
                "goal": answer.goal + 1,
                "proved": answer.proved,
                "looked": answer.looked,
                "stretches": answer.stretches,
                "refined": answer.refined,
            }
        case Refused():
            return {"reasons": [_reason(each, joints) for each in answer.reasons]}
        case Blocked():
            return {
                "ends": answer.ends.tolist(),
                "apart": answer.apart,
                "looked": answer.looked,
                "grown": list(answer.grown),
                "at": answer.at.tolist(),
                "contacts": [_contact(each) for each in answer.contacts],
            }


def _reason(reason: Reason, joints: Sequence[str]) -> dict[str, Any]:
    match reason:
        case OutsideLimits():
            limits = {"lower": reason.lower, "upper": reason.upper}
            return {"of": reason.of, "joint": _name(reason.joint, joints), "value": reason.value, **limits}
        case InCollision():
            return {"of": reason.of, "contacts": [_contact(each) for each in reason.contacts]}


def _name(joint: int, joints: Sequence[str]) -> str:
    return joints[joint] if joint < len(joints) else f"joint {joint + 1}"


def _contact(contact: Contact) -> dict[str, Any]:
    return {"between": [contact.first, contact.second], "distance_m": contact.distance_m}


def text(answer: Answer, joints: Sequence[str], path: Floats, times: Floats) -> str:
    """An answer for people: angles in degrees."""
    match answer:
        case Moved():
            rows = [f"{t:8.3f} s  {_values(q)}" for t, q in zip(times, path, strict=True)]
            said = "proved free everywhere" if answer.proved else "free where it was looked at, not proved"
            head = f"a path of {len(path)} configurations, {times[-1]:.2f} s, {said}"
            rests = ["it rests at each configuration"] if len(path) > 2 else []
            return "\n".join([head, *rows, *rests])
        case Refused():
            return "\n".join(_told(each, joints) for each in answer.reasons)
        case Blocked():
            told = [_touching(each) for each in answer.contacts[:SHOWN]]
            return "\n".join(
                [
                    f"no path found: {answer.looked} configurations looked at, {sum(answer.grown)} reached",
                    f"from the start it gets to  {_values(answer.ends[0])}",
                    f"from the goal it gets to   {_values(answer.ends[1])}",
                    f"between them, at {_values(answer.at)}, {', '.join(told) or 'nothing is near'}",
                ]
            )


def _told(reason: Reason, joints: Sequence[str]) -> str:
    match reason:
        case OutsideLimits():
            name, least, most = _name(reason.joint, joints), reason.lower, reason.upper
            return f"{reason.of}: {name} is at {reason.value:.4g}, its limits are {least:.4g} and {most:.4g} (rad or m)"
        case InCollision():
            return f"{reason.of}: {', '.join(_touching(each) for each in reason.contacts[:SHOWN])}"


def _touching(contact: Contact) -> str:
    if contact.distance_m <= 0:
        return f"{contact.first} overlaps {contact.second} by {contact.depth_m * 1000:.1f} mm"
    return f"{contact.first} is only {contact.distance_m * 1000:.1f} mm from {contact.second}"


def _values(q: Floats) -> str:
    return ", ".join(f"{math.degrees(value):.1f}" for value in q)
