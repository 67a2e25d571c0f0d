"""Answers of `place` as text (millimetres, degrees) and as data (metres, radians)."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.model.manipulation_values import Assembled, Freedom, Grasp
from cellwright.engine.model.vision import PoseHypothesis
from cellwright.engine.pipelines.manipulation.place_answers import (
    Carry,
    NotPlaced,
    PathLeg,
    PlaceAnswer,
    Placed,
)
from cellwright.engine.pipelines.manipulation.place_operation import STILL_M, STILL_RAD, SecondLook
from cellwright.engine.pipelines.manipulation.pose_uncertainty import at_goal
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.grasping.hole_insertion import HoleSearch, Insertion

PLACING_STATUS = {"relations": "infeasible", "regrasp": "infeasible"}


def placing_status(answer: PlaceAnswer) -> str:
    """The status word of an answer: what is proved impossible is infeasible, all else that
    failed is given up.
    """
    return "found" if isinstance(answer, Placed) else PLACING_STATUS.get(answer.step, "gave up")


def placing_content(answer: PlaceAnswer) -> dict[str, Any]:
    """An answer for JSON: poses as rows of matrices, metres and radians."""
    if isinstance(answer, NotPlaced):
        return {"step": answer.step, "reason": answer.reason, "hint": answer.hint}
    return {
        "goal": {
            "T_world_part": answer.T_world_goal.tolist(),
            "degrees": answer.goal.degrees,
            "redundant": list(map(str, answer.goal.redundant)),
            "covariance": at_goal(answer).tolist(),
        },
        "found": {
            "T_world_part": answer.T_world_part.tolist(),
            "covariance": answer.sighting.covariance.tolist(),
            "best": _hypothesis_entry(answer.sighting.best),
            "second": _hypothesis_entry(answer.sighting.second) if answer.sighting.second else None,
            "equivalent": len(answer.sighting.equivalent),
        },
        "holds": dict(zip(("all", "at_start", "at_goal"), answer.holds, strict=True)),
        "carries": [carry_entry(part_carry) for part_carry in answer.carries],
    }


def at_facets(grasp: Grasp) -> str:
    """Where a part is held, and how wide."""
    *first, last = grasp.facets
    return f"{', '.join(first)} and {last}, {1000 * grasp.width_m:.1f} mm apart"


def _hypothesis_entry(hypothesis: PoseHypothesis) -> dict[str, float]:
    return {
        "agreeing": hypothesis.agreeing,
        "seen": hypothesis.seen,
        "edged": hypothesis.edged,
        "pixels": hypothesis.pixels,
    }


def carry_entry(part_carry: Carry) -> dict[str, Any]:
    """One taking and letting go."""
    return {
        "facets": list(part_carry.grasp.facets),
        "width_m": part_carry.grasp.width_m,
        "torque_margin": part_carry.grasp.torque_margin,
        "T_part_hand": part_carry.T_part_hand.tolist(),
        "T_world_to": part_carry.T_world_to.tolist(),
        "rest": part_carry.rest,
        "legs": [leg_entry(carry_leg) for carry_leg in part_carry.legs],
        "insertion": None
        if part_carry.insertion is None
        else _insertion_entry(part_carry.insertion),
    }


def _insertion_entry(insertion: Insertion) -> dict[str, Any]:
    """How a part goes in where it is enclosed: metres."""
    return {
        "depth_m": insertion.depth_m,
        "room_m": insertion.room_m,
        "doubt_m": insertion.doubt_m,
        "search": insertion.search.value,
    }


def leg_entry(motion_leg: PathLeg) -> dict[str, Any]:
    """A stretch of motion."""
    return {
        "what": motion_leg.what,
        "path": motion_leg.path.tolist(),
        "carries": motion_leg.carries,
        "proved": motion_leg.proved,
    }


def placing_text(answer: PlaceAnswer, part: str, base: str) -> str:
    """An answer for people."""
    if isinstance(answer, NotPlaced):
        return f"{part} is not placed on {base}: {answer.reason}\n  try: {answer.hint}"
    every, start, goal = answer.holds
    lines = [
        f"{part} lies at {pose_text(answer.T_world_part)}, {_sureness_text(answer)}",
        f"{part} belongs at {pose_text(answer.T_world_goal)}, {freedom_text(answer.goal)}",
        f"there it will be within {_worst_deviation(at_goal(answer))} of that (three standard "
        "deviations of what was seen)",
        f"{every} ways to hold it: {start} are possible where it lies, {goal} at its goal",
    ]
    for n, part_carry in enumerate(answer.carries, 1):
        lines += _carry_lines(n, part_carry)
    return "\n".join(lines)


def second_look_text(look: SecondLook, part: str) -> str:
    """What a second look says of the first, as a line."""
    if np.isinf(look.moved_m):
        return f"{part} is not where it was any more\n"
    moved = f"{1000 * look.moved_m:.1f} mm and {np.degrees(look.moved_rad):.1f} degrees"
    if isinstance(look.answer, Placed) and look.moved_m < STILL_M and look.moved_rad < STILL_RAD:
        return f"{part} is where it was, within {moved}\n"
    return f"{part} has moved by {moved}: planned anew\n"


def _worst_deviation(covariance: Floats) -> str:
    """Three standard deviations in the worst direction."""
    worst = [
        3 * float(np.sqrt(np.linalg.eigvalsh(block)[-1]))
        for block in (covariance[:3, :3], covariance[3:, 3:])
    ]
    return f"{1000 * worst[0]:.2f} mm and {np.degrees(worst[1]):.2f} degrees"


def pose_text(T: Floats) -> str:
    """A pose for people."""
    pose_values = transforms.to_pose(T)
    at = ", ".join(f"{_round_to_tenth(1000 * x):.1f}" for x in pose_values.position_m)
    return (
        f"{at} mm, turned "
        f"{', '.join(f'{_round_to_tenth(np.degrees(x)):.1f}' for x in pose_values.rpy_rad)} degrees"
    )


def _round_to_tenth(value: float) -> float:
    """One digit after the point, and no zero with a sign."""
    return round(float(value), 1) + 0.0


def _sureness_text(answer: Placed) -> str:
    sigma = np.sqrt(np.diag(answer.sighting.covariance))
    many = len(answer.sighting.equivalent)
    alike = f"; {many} poses look the same" if many > 1 else ""
    return (
        f"standard deviations {1000 * sigma[:3].max():.2f} mm and "
        f"{np.degrees(sigma[3:].max()):.2f} degrees{alike}"
    )


def freedom_text(goal: Assembled) -> str:
    """What relations leave free, and which follow from others."""
    freedom_texts = [_one_freedom(freedom) for freedom in goal.freedoms]
    free = (
        f"where it may still {', '.join(freedom_texts)}"
        if freedom_texts
        else "where nothing is free"
    )
    redundant = [
        f"'{redundant_relation}' follows from the other relations"
        for redundant_relation in goal.redundant
    ]
    return "; ".join([free, *redundant])


def _one_freedom(freedom: Freedom) -> str:
    along = ", ".join(f"{x:.2f}" for x in freedom.direction + 0.0)
    return f"slide along ({along})" if np.isinf(freedom.pitch_m) else f"turn about ({along})"


def _carry_lines(n: int, carry: Carry) -> Iterator[str]:
    to = "to its goal" if carry.rest == "goal" else f"to the free place, to lie {carry.rest}"
    yield f"{n}. taken at {at_facets(carry.grasp)}, and carried {to}"
    yield from map(leg_text, carry.legs)
    if carry.insertion is not None:
        yield f"   {_insertion_text(carry.insertion)}"


def _insertion_text(insertion: Insertion) -> str:
    """How a part goes in, for people."""
    how = {
        HoleSearch.NONE: "it goes straight in",
        HoleSearch.SPIRAL: "it is pressed lightly, and led round on a spiral until it drops",
        HoleSearch.TILT: "it is tilted, led against the far wall, and set upright there",
    }
    room, doubt = 1000 * insertion.room_m, 1000 * insertion.doubt_m
    return (
        f"it goes {1000 * insertion.depth_m:.0f} mm deep with {room:.2f} mm of room on each "
        f"side, and may be {doubt:.2f} mm off: "
        f"{how[insertion.search]}"
    )


def leg_text(leg: PathLeg) -> str:
    """A stretch of motion as a line."""
    proved = (
        "proved free everywhere" if leg.proved else "a straight line, free where it was looked at"
    )
    return f"   {leg.what:<12} {len(leg.path)} configurations, {proved}"
