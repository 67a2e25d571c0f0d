"""Why there is no motion, as text and as content for JSON."""

import math
from collections.abc import Sequence
from typing import Any

from cellwright.engine.model.geometry import Contact, Floats
from cellwright.engine.model.motion import Blocked, InCollision, OutsideLimits, Reason, Refused, Severed

SHOWN = 3  # contacts that are named
MOST = 5  # ends that are told of


def content_of(answer: Refused | Blocked, joints: Sequence[str]) -> dict[str, Any]:
    """The reason for JSON: rad and m."""
    match answer:
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
                "why": answer.why,
                "severed": _severed(answer.severed, joints) if answer.severed else None,
            }


def _reason(reason: Reason, joints: Sequence[str]) -> dict[str, Any]:
    match reason:
        case OutsideLimits():
            limits = {"lower": reason.lower, "upper": reason.upper}
            return {"of": reason.of, "joint": _name(reason.joint, joints), "value": reason.value, **limits}
        case InCollision():
            return {"of": reason.of, "contacts": [_contact(each) for each in reason.contacts]}


def _severed(proof: Severed, joints: Sequence[str]) -> dict[str, Any]:
    return {
        "joints": [_name(each, joints) for each in proof.joints],
        "cells": proof.cells,
        "at": proof.at.tolist(),
        "contacts": [_contact(each) for each in proof.contacts],
    }


def _name(joint: int, joints: Sequence[str]) -> str:
    return joints[joint] if joint < len(joints) else f"joint {joint + 1}"


def _contact(contact: Contact) -> dict[str, Any]:
    return {"between": [contact.first, contact.second], "distance_m": contact.distance_m}


def text_of(answer: Refused | Blocked, joints: Sequence[str], slides: Sequence[bool]) -> str:
    """The reason for people: degrees and m."""
    match answer:
        case Refused():
            told = [_told(each, joints, slides) for each in answer.reasons]
            more = [f"and {len(told) - MOST} more: --format json has them all"] if len(told) > MOST else []
            return "\n".join([*told[:MOST], *more])
        case Blocked():
            told = [_touching(each) for each in answer.contacts[:SHOWN]]
            sure = [_cut_off(answer.severed, joints)] if answer.severed else []
            why = [f"{answer.why[0].upper()}{answer.why[1:]}."] if answer.why else []
            reached = "" if answer.why else f", {sum(answer.grown)} reached"
            return "\n".join(
                [
                    f"no path found: {answer.looked} configurations looked at{reached}",
                    *sure,
                    *why,
                    f"from the start it gets to  {_values(answer.ends[0], slides)}",
                    f"from the goal it gets to   {_values(answer.ends[1], slides)}",
                    f"between them, at {_values(answer.at, slides)}, {', '.join(told) or 'nothing is near'}",
                ]
            )


def _cut_off(proof: Severed, joints: Sequence[str]) -> str:
    """The sentence of a proof that there is no path."""
    names = " and ".join(_name(each, joints) for each in proof.joints)
    first, second = proof.contacts[0].first, proof.contacts[0].second
    verb = "does" if len(proof.joints) == 1 else "do"
    return f"there is none, that is proved: whatever {names} {verb}, {first} cannot pass {second}"


def _told(reason: Reason, joints: Sequence[str], slides: Sequence[bool]) -> str:
    match reason:
        case OutsideLimits():
            name, slid = _name(reason.joint, joints), reason.joint < len(slides) and slides[reason.joint]
            value, least, most = (_value(x, slid) for x in (reason.value, reason.lower, reason.upper))
            over = _value(max(reason.lower - reason.value, reason.value - reason.upper), slid)
            unit = "m" if slid else "degrees"
            return f"{reason.of}: {name} is at {value}, {over} {unit} beyond its limits, {least} and {most}"
        case InCollision():
            return f"{reason.of}: {', '.join(_touching(each) for each in reason.contacts[:SHOWN])}"


def _value(value: float, slid: bool) -> str:
    return f"{value:.4g}" if slid else f"{math.degrees(value):.4g}"


def _touching(contact: Contact) -> str:
    if contact.distance_m <= 0:
        return f"{contact.first} overlaps {contact.second} by {contact.depth_m * 1000:.1f} mm"
    return f"{contact.first} is only {contact.distance_m * 1000:.1f} mm from {contact.second}"


def _values(q: Floats, slides: Sequence[bool]) -> str:
    padded = [*slides, *[False] * (len(q) - len(slides))]
    return ", ".join(_value(value, slid) for value, slid in zip(q, padded, strict=True))
