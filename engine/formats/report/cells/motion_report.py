"""A planned motion, or the reasons why there is none, as text and as data."""

import math
from collections.abc import Sequence
from typing import Any

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.model.geometry import Contact
from cellwright.engine.model.motion_values import (
    Answer,
    Blocked,
    InCollision,
    Moved,
    OutsideLimits,
    Reason,
    RefusedQuery,
    Severed,
)
from cellwright.engine.pipelines.motion.arm_motion import ArmMotion
from cellwright.engine.pipelines.motion.motion_legs import APPROACH, RETRACT, MotionLeg

MAX_SHOWN_CONTACTS = 3  # contacts that are named
MAX_SHOWN_ENDS = 5  # ends that are told of


def content_of(answer: RefusedQuery | Blocked, joints: Sequence[str]) -> dict[str, Any]:
    """The reason for JSON: rad and m."""
    match answer:
        case RefusedQuery():
            return {"reasons": [_reason_entry(reason, joints) for reason in answer.reasons]}
        case Blocked():
            return {
                "ends": answer.ends.tolist(),
                "apart": answer.apart,
                "looked": answer.looked,
                "grown": list(answer.grown),
                "at": answer.at.tolist(),
                "contacts": [_contact_entry(contact) for contact in answer.contacts],
                "why": answer.why,
                "severed": _severed_entry(answer.severed, joints) if answer.severed else None,
            }


def _reason_entry(reason: Reason, joints: Sequence[str]) -> dict[str, Any]:
    match reason:
        case OutsideLimits():
            limits = {"lower": reason.lower, "upper": reason.upper}
            return {
                "of": reason.of,
                "joint": _joint_name(reason.joint, joints),
                "value": reason.value,
                **limits,
            }
        case InCollision():
            return {
                "of": reason.of,
                "contacts": [_contact_entry(contact) for contact in reason.contacts],
            }


def _severed_entry(proof: Severed, joints: Sequence[str]) -> dict[str, Any]:
    return {
        "joints": [_joint_name(joint, joints) for joint in proof.joints],
        "cells": proof.cells,
        "at": proof.at.tolist(),
        "contacts": [_contact_entry(contact) for contact in proof.contacts],
    }


def _joint_name(joint: int, joints: Sequence[str]) -> str:
    return joints[joint] if joint < len(joints) else f"joint {joint + 1}"


def _contact_entry(contact: Contact) -> dict[str, Any]:
    return {"between": [contact.first, contact.second], "distance_m": contact.distance_m}


def no_motion_text(
    answer: RefusedQuery | Blocked, joints: Sequence[str], slides: Sequence[bool]
) -> str:
    """The reason for people: degrees and m."""
    match answer:
        case RefusedQuery():
            reason_lines = [_reason_text(reason, joints, slides) for reason in answer.reasons]
            more = (
                [f"and {len(reason_lines) - MAX_SHOWN_ENDS} more: --format json has them all"]
                if len(reason_lines) > MAX_SHOWN_ENDS
                else []
            )
            return "\n".join([*reason_lines[:MAX_SHOWN_ENDS], *more])
        case Blocked():
            reason_lines = [
                _contact_text(contact) for contact in answer.contacts[:MAX_SHOWN_CONTACTS]
            ]
            sure = [_cut_off(answer.severed, joints)] if answer.severed else []
            why = [f"{answer.why[0].upper()}{answer.why[1:]}."] if answer.why else []
            reached = "" if answer.why else f", {sum(answer.grown)} reached"
            return "\n".join(
                [
                    f"no path found: {answer.looked} configurations looked at{reached}",
                    *sure,
                    *why,
                    f"from the start it gets to  {_joint_values(answer.ends[0], slides)}",
                    f"from the goal it gets to   {_joint_values(answer.ends[1], slides)}",
                    f"between them, at {_joint_values(answer.at, slides)}, "
                    f"{', '.join(reason_lines) or 'nothing is near'}",
                ]
            )


def _cut_off(proof: Severed, joints: Sequence[str]) -> str:
    """The sentence of a proof that there is no path."""
    names = " and ".join(_joint_name(joint, joints) for joint in proof.joints)
    first, second = proof.contacts[0].first, proof.contacts[0].second
    verb = "does" if len(proof.joints) == 1 else "do"
    return f"there is none, that is proved: whatever {names} {verb}, {first} cannot pass {second}"


def _reason_text(reason: Reason, joints: Sequence[str], slides: Sequence[bool]) -> str:
    match reason:
        case OutsideLimits():
            name, slid = (
                _joint_name(reason.joint, joints),
                reason.joint < len(slides) and slides[reason.joint],
            )
            value, least, most = (
                _joint_value(x, slid) for x in (reason.value, reason.lower, reason.upper)
            )
            over = _joint_value(max(reason.lower - reason.value, reason.value - reason.upper), slid)
            unit = "m" if slid else "degrees"
            return (
                f"{reason.of}: {name} is at {value}, {over} {unit} beyond its limits, {least} "
                f"and {most}"
            )
        case InCollision():
            return (
                f"{reason.of}: "
                f"{', '.join(_contact_text(contact) for contact in reason.contacts[:MAX_SHOWN_CONTACTS])}"
            )


def _joint_value(value: float, slid: bool) -> str:
    return f"{value:.4g}" if slid else f"{math.degrees(value):.4g}"


def _contact_text(contact: Contact) -> str:
    if contact.distance_m <= 0:
        return f"{contact.first} overlaps {contact.second} by {contact.depth_m * 1000:.1f} mm"
    return f"{contact.first} is only {contact.distance_m * 1000:.1f} mm from {contact.second}"


def _joint_values(q: Floats, slides: Sequence[bool]) -> str:
    padded = [*slides, *[False] * (len(q) - len(slides))]
    return ", ".join(_joint_value(value, slid) for value, slid in zip(q, padded, strict=True))


MAX_SHOWN_CONFIGURATIONS = 16  # configurations of a leg that are shown
LEG_WORDS = {RETRACT: "straight out", APPROACH: "straight in"}


def motion_status(answer: Answer) -> str:
    """The status word of an answer."""
    match answer:
        case Moved():
            return "found"
        case RefusedQuery():
            return "infeasible"
        case Blocked():
            return "infeasible" if answer.severed else "gave up"


def motion_content(motion: ArmMotion) -> dict[str, Any]:
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
        "legs": [_motion_leg_entry(leg) for leg in motion.legs],
        "slow_in": list(motion.times.slow),
    }


def _motion_leg_entry(leg: MotionLeg) -> dict[str, Any]:
    touches = [
        {
            "between": [touch.first, touch.second],
            "deepest_m": touch.deepest_m,
            "allowed_m": touch.allowed_m,
            "proved": touch.proved,
        }
        for touch in leg.touches
    ]
    return {
        "kind": leg.kind,
        "configurations": len(leg.path),
        "proved": leg.proved,
        "touches": touches,
    }


def motion_text(motion: ArmMotion) -> str:
    """A motion for people: angles in degrees, lengths in m."""
    answer = motion.answer
    if not isinstance(answer, Moved):
        return no_motion_text(answer, motion.joints, motion.slides)
    path, times = motion.path(), motion.times.corners_s()
    proof_note = (
        "proved free everywhere" if motion.proved else "free where it was looked at, not proved"
    )
    head = (
        f"to {motion.goal}: {len(path)} configurations, {motion.times.duration_s:.2f} s, "
        f"{proof_note}"
    )
    lines, n = [head], 0
    for leg in motion.legs:
        kind = LEG_WORDS.get(leg.kind, "")
        rows = range(n + (1 if n else 0), n + len(leg.path))
        shown = [
            f"{times[row]:8.3f} s  {joint_values_text(path[row], motion.slides)}  {kind}".rstrip()
            for row in rows
        ]
        lines += (
            shown
            if len(shown) <= MAX_SHOWN_CONFIGURATIONS
            else [
                *shown[: MAX_SHOWN_CONFIGURATIONS - 2],
                _left_out(len(shown) - MAX_SHOWN_CONFIGURATIONS + 1),
                shown[-1],
            ]
        )
        n += len(leg.path) - 1
        lines += [_touch_text(touch) for touch in leg.touches]
    lines += [f"slow in {name}, because people may be there" for name in motion.times.slow]
    return "\n".join([*lines, *_rest_lines(motion)])


def _left_out(count: int) -> str:
    return f"            and {count} more: --format json has them all"


def _rest_lines(motion: ArmMotion) -> list[str]:
    if len(motion.path()) < 3:
        return []
    if motion.times.cuts:
        return [
            "where it does not rest it cuts the corner, and passes nearest to it at the time shown"
        ]
    return ["it rests at each configuration"]


def _touch_text(touch: Any) -> str:
    most = f"at most {touch.allowed_m * 1000:g} mm deep"
    if touch.proved:
        return f"            {touch.first} touches {touch.second} as declared, proved {most}"
    return (
        f"            {touch.first} goes {touch.deepest_m * 1000:.1f} mm into {touch.second}: "
        f"NOT proved {most};"
        " declare `depth` at the place, or move it"
    )


def joint_values_text(q: Floats, slides: Sequence[bool]) -> str:
    """The joint values (k,) of a configuration."""
    shown = zip(q, slides, strict=True)
    return ", ".join(
        f"{value:.3f} m" if slid else f"{math.degrees(value):.1f}" for value, slid in shown
    )
