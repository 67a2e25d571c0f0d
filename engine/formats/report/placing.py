"""What PLACE answers, as text and as content for JSON. Lengths are told in millimetres, angles in degrees."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from cellwright.engine.model.assembly import Assembled, Freedom
from cellwright.engine.model.geometry import Floats
from cellwright.engine.model.grasping import Grasp
from cellwright.engine.model.vision import Hypothesis
from cellwright.engine.pipelines.placing.answers import Carry, Leg, NotPlaced, PlaceAnswer, Placed
from cellwright.engine.pipelines.placing.doubt import at_goal
from cellwright.engine.pipelines.placing.placing import STILL_M, STILL_RAD, Since
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.grasping.insertion import Insertion, Search

STATUS = {"relations": "infeasible", "regrasp": "infeasible"}


def status(answer: PlaceAnswer) -> str:
    """The status word of an answer: what is proved impossible is infeasible, all else that failed is given up."""
    return "found" if isinstance(answer, Placed) else STATUS.get(answer.step, "gave up")


def content(answer: PlaceAnswer) -> dict[str, Any]:
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
            "best": _hypothesis(answer.sighting.best),
            "second": _hypothesis(answer.sighting.second) if answer.sighting.second else None,
            "equivalent": len(answer.sighting.equivalent),
        },
        "holds": dict(zip(("all", "at_start", "at_goal"), answer.holds, strict=True)),
        "carries": [carry(each) for each in answer.carries],
    }


def at_facets(grasp: Grasp) -> str:
    """Where a part is held, and how wide."""
    *first, last = grasp.facets
    return f"{', '.join(first)} and {last}, {1000 * grasp.width_m:.1f} mm apart"


def _hypothesis(one: Hypothesis) -> dict[str, float]:
    return {"agreeing": one.agreeing, "seen": one.seen, "edged": one.edged, "pixels": one.pixels}


def carry(one: Carry) -> dict[str, Any]:
    """One taking and letting go."""
    return {
        "facets": list(one.grasp.facets),
        "width_m": one.grasp.width_m,
        "torque_margin": one.grasp.torque_margin,
        "T_part_hand": one.T_part_hand.tolist(),
        "T_world_to": one.T_world_to.tolist(),
        "rest": one.rest,
        "legs": [leg(each) for each in one.legs],
        "insertion": None if one.insertion is None else _inserted(one.insertion),
    }


def _inserted(one: Insertion) -> dict[str, Any]:
    """How a part goes in where it is enclosed: metres."""
    return {"depth_m": one.depth_m, "room_m": one.room_m, "doubt_m": one.doubt_m, "search": one.search.value}


def leg(one: Leg) -> dict[str, Any]:
    """A stretch of motion."""
    return {"what": one.what, "path": one.path.tolist(), "carries": one.carries, "proved": one.proved}


def text(answer: PlaceAnswer, part: str, base: str) -> str:
    """An answer for people."""
    if isinstance(answer, NotPlaced):
        return f"{part} is not placed on {base}: {answer.reason}\n  try: {answer.hint}"
    every, start, goal = answer.holds
    lines = [
        f"{part} lies at {pose(answer.T_world_part)}, {_sureness(answer)}",
        f"{part} belongs at {pose(answer.T_world_goal)}, {free(answer.goal)}",
        f"there it will be within {_within(at_goal(answer))} of that (three standard deviations of what was seen)",
        f"{every} ways to hold it: {start} are possible where it lies, {goal} at its goal",
    ]
    for n, each in enumerate(answer.carries, 1):
        lines += _told(n, each)
    return "\n".join(lines)


def since(look: Since, part: str) -> str:
    """What a second look says of the first, as a line."""
    if np.isinf(look.moved_m):
        return f"{part} is not where it was any more\n"
    moved = f"{1000 * look.moved_m:.1f} mm and {np.degrees(look.moved_rad):.1f} degrees"
    if isinstance(look.answer, Placed) and look.moved_m < STILL_M and look.moved_rad < STILL_RAD:
        return f"{part} is where it was, within {moved}\n"
    return f"{part} has moved by {moved}: planned anew\n"


def _within(covariance: Floats) -> str:
    """Three standard deviations in the worst direction."""
    worst = [
        3 * float(np.sqrt(np.linalg.eigvalsh(block)[-1]))
        for block in (covariance[:3, :3], covariance[3:, 3:])
    ]
    return f"{1000 * worst[0]:.2f} mm and {np.degrees(worst[1]):.2f} degrees"


def pose(T: Floats) -> str:
    """A pose for people."""
    found = transforms.to_pose(T)
    at = ", ".join(f"{_rounded(1000 * x):.1f}" for x in found.position_m)
    return f"{at} mm, turned {', '.join(f'{_rounded(np.degrees(x)):.1f}' for x in found.rpy_rad)} degrees"


def _rounded(value: float) -> float:
    """One digit after the point, and no zero with a sign."""
    return round(float(value), 1) + 0.0


def _sureness(answer: Placed) -> str:
    sigma = np.sqrt(np.diag(answer.sighting.covariance))
    many = len(answer.sighting.equivalent)
    alike = f"; {many} poses look the same" if many > 1 else ""
    return f"standard deviations {1000 * sigma[:3].max():.2f} mm and {np.degrees(sigma[3:].max()):.2f} degrees{alike}"


def free(goal: Assembled) -> str:
    """What relations leave free, and which follow from others."""
    said = [_freedom(each) for each in goal.freedoms]
    free = f"where it may still {', '.join(said)}" if said else "where nothing is free"
    redundant = [f"'{each}' follows from the other relations" for each in goal.redundant]
    return "; ".join([free, *redundant])


def _freedom(one: Freedom) -> str:
    along = ", ".join(f"{x:.2f}" for x in one.direction + 0.0)
    return f"slide along ({along})" if np.isinf(one.pitch_m) else f"turn about ({along})"


def _told(n: int, carry: Carry) -> Iterator[str]:
    to = "to its goal" if carry.rest == "goal" else f"to the free place, to lie {carry.rest}"
    yield f"{n}. taken at {at_facets(carry.grasp)}, and carried {to}"
    yield from map(told, carry.legs)
    if carry.insertion is not None:
        yield f"   {_fits(carry.insertion)}"


def _fits(one: Insertion) -> str:
    """How a part goes in, for people."""
    how = {
        Search.NONE: "it goes straight in",
        Search.SPIRAL: "it is pressed lightly, and led round on a spiral until it drops",
        Search.TILT: "it is tilted, led against the far wall, and set upright there",
    }
    room, doubt = 1000 * one.room_m, 1000 * one.doubt_m
    return (
        f"it goes {1000 * one.depth_m:.0f} mm deep with {room:.2f} mm of room on each side, and may be {doubt:.2f} mm off: "
        f"{how[one.search]}"
    )


def told(leg: Leg) -> str:
    """A stretch of motion as a line."""
    proved = "proved free everywhere" if leg.proved else "a straight line, free where it was looked at"
    return f"   {leg.what:<12} {len(leg.path)} configurations, {proved}"
