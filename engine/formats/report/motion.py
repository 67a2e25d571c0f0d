"""A planned motion as text, as content for JSON, and as a picture of joint values over time."""

import math
from collections.abc import Sequence
from typing import Any

from engine.formats.report.palette import colours
from engine.formats.report.svg import INK, PAPER
from engine.model.geometry import Contact, Floats
from engine.model.motion import Answer, Blocked, InCollision, Moved, OutsideLimits, Reason, Refused

WIDTH, HEIGHT, MARGIN, LINE = 860.0, 420.0, 50.0, 18.0  # pixels
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
            return "\n".join([head, *rows])
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


def picture(joints: Sequence[str], path: Floats, times: Floats) -> str:
    """The SVG of joint values (m, k) over time (m,)."""
    inks = colours(joints)
    low, high = float(path.min()), float(path.max())
    span, whole = max(high - low, 1e-9), max(float(times[-1]), 1e-9)
    tall = HEIGHT + LINE * len(joints)

    def at(t: float, value: float) -> str:
        x = MARGIN + (WIDTH - 2 * MARGIN) * t / whole
        return f"{x:.1f},{HEIGHT - MARGIN - (HEIGHT - 2 * MARGIN) * (value - low) / span:.1f}"

    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH:g}" height="{tall:g}" font-family="sans-serif" '
        f'font-size="12">',
        f'<rect width="100%" height="100%" fill="{PAPER}"/>',
        f'<path d="M {at(0, high)} L {at(0, low)} L {at(whole, low)}" fill="none" stroke="{INK}"/>',
        f'<text x="4" y="{MARGIN:g}" fill="{INK}">{high:.2f}</text>',
        f'<text x="4" y="{HEIGHT - MARGIN:g}" fill="{INK}">{low:.2f}</text>',
        f'<text x="{WIDTH - MARGIN:g}" y="{HEIGHT - MARGIN + LINE:g}" fill="{INK}">{whole:.2f} s</text>',
    ]
    for n, name in enumerate(joints):
        points = " ".join(at(float(t), float(q[n])) for t, q in zip(times, path, strict=True))
        lines.append(f'<polyline points="{points}" fill="none" stroke="{inks[name]}" stroke-width="2"/>')
        y = HEIGHT + LINE * n
        lines.append(f'<text x="{MARGIN:g}" y="{y:g}" fill="{inks[name]}">{_escaped(name)}</text>')
    return "\n".join([*lines, "</svg>"]) + "\n"


def _escaped(name: str) -> str:
    from xml.sax.saxutils import escape

    return escape(name)
