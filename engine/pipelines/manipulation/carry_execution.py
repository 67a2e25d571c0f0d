"""Execution of a planned carry in MuJoCo: it stops where something is not as planned."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from enum import StrEnum

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.pipelines.manipulation.carry_paths import LIFT_M
from cellwright.engine.pipelines.manipulation.force_insertion import (
    SEARCH_ABOVE_RIM_M,
    insert_part,
    raise_up,
)
from cellwright.engine.pipelines.manipulation.mujoco_cell import MujocoCell
from cellwright.engine.pipelines.manipulation.place_answers import Carry, PathLeg
from cellwright.engine.stages.grasping.hole_insertion import HoleSearch, Insertion

GUARD_N = 15.0  # a push that stops the hand on its way to a part
# fingers that close farther than this below the part's width hold something else, or nothing
NARROW_M = 0.003
LOST_S = 0.05  # a finger may leave a part for less, as when it is set down
SEARCH_WIDENING = 2.0  # times what was doubted: a second search
SHORT_M = 0.004  # a hand that stays so far before its goal has met something there


class CarryEnd(StrEnum):
    """How a carry ended: the replies of the fault base."""

    DONE = "done"
    TOUCHED = "touched"
    NOT_GRIPPED = "not_gripped"
    LOST = "lost"
    BLOCKED = "blocked"


def execute_carry(shop: MujocoCell, part: str, carry: Carry) -> CarryEnd:
    """Take a part and let it go as planned.

    After a failure the arm is where it can go on from: backed off, and empty.
    """
    taken = take_up(shop, part, carry)
    return taken if taken is not CarryEnd.DONE else put_down(shop, part, carry)


def take_up(shop: MujocoCell, part: str, carry: Carry) -> CarryEnd:
    """Take a part, and carry it to above where it is to go."""
    legs = {leg.what: leg for leg in carry.legs}
    shop.open_for(carry.grasp.opening)
    shop.permit()
    shop.follow(_arm_path(shop, legs["to the part"]))
    way_in = _arm_path(shop, legs["approach"])
    shop.permit(part)
    if not shop.follow(way_in, lambda: shop.push_n() > GUARD_N):
        _go_back(shop, way_in)
        return CarryEnd.TOUCHED
    if shop.close() < carry.grasp.width_m - NARROW_M or not shop.holds(part):
        shop.open_for(carry.grasp.opening)
        _go_back(shop, way_in)
        return CarryEnd.NOT_GRIPPED
    shop.load = part
    return (
        CarryEnd.DONE
        if all(_follow_with_part(shop, part, legs[name]) for name in ("lift", "carry"))
        else CarryEnd.LOST
    )


def put_down(shop: MujocoCell, part: str, carry: Carry) -> CarryEnd:
    """Let a part go that is held above where it is to go; it is inserted where it is enclosed
    there.
    """
    legs = {leg.what: leg for leg in carry.legs}
    if carry.insertion is not None:
        return _put_in(shop, part, carry, legs)
    if not _follow_with_part(shop, part, legs["lower"]):
        return CarryEnd.LOST
    return _let_go(shop, part, carry, legs["withdraw"])


def _put_in(shop: MujocoCell, part: str, carry: Carry, legs: Mapping[str, PathLeg]) -> CarryEnd:
    """Lower the part to above its hole, and insert it by the sense of force.

    What does not go in is brought back up.
    """
    assert carry.insertion is not None
    lower = legs["lower"]
    if not _follow_with_part(
        shop, part, replace(lower, path=_above_rim(lower.path, carry.insertion))
    ):
        return CarryEnd.LOST
    shop.permit(*shop.scene.cell.bodies)
    if insert_part(shop, part, carry):
        return _let_go(shop, part, carry, legs["withdraw"])
    return CarryEnd.BLOCKED if shop.holds(part) else _leave_part(shop, lower)


def searched_on(shop: MujocoCell, part: str, carry: Carry) -> CarryEnd:
    """Search for the hole with a part that did not go in, on a spiral that is wider; it is laid
    down there if this fails, too.
    """
    legs, plan = {leg.what: leg for leg in carry.legs}, carry.insertion
    if plan is None or not shop.holds(part):
        return _leave_part(shop, legs["lower"])
    wider = replace(
        plan, search=HoleSearch.SPIRAL, doubt_m=SEARCH_WIDENING * max(plan.doubt_m, plan.room_m)
    )
    again = replace(carry, insertion=wider)
    raise_up(shop, again)
    if insert_part(shop, part, again):
        return _let_go(shop, part, carry, legs["withdraw"])
    return _leave_part(shop, legs["lower"])


def _leave_part(shop: MujocoCell, lower: PathLeg) -> CarryEnd:
    """The part is left where it is, and the hand backs off."""
    shop.open_wide()
    _go_back(shop, _arm_path(shop, lower))
    return CarryEnd.LOST


def _above_rim(path: Floats, plan: Insertion) -> Floats:
    """The part of a straight way down that ends above the rim; its corners are at even
    distances.
    """
    most = max(0.0, 1.0 - (plan.depth_m + SEARCH_ABOVE_RIM_M) / LIFT_M) * (len(path) - 1)
    whole = int(most)
    if whole == len(path) - 1:
        return path
    last = path[whole] + (most - whole) * (path[whole + 1] - path[whole])
    return np.concatenate([path[: whole + 1], last[None]])


def _follow_with_part(shop: MujocoCell, part: str, leg: PathLeg) -> bool:
    """Follow a leg with the part in the hand; whether it is still there.

    What the part stands on may be touched near it.
    """
    shop.permit(*(shop.scene.cell.bodies if leg.what != "carry" else ()))
    if shop.follow(_arm_path(shop, leg), _part_lost(shop, part), carries=True):
        return True
    shop.open_wide()
    if leg.what == "lower":
        _go_back(shop, _arm_path(shop, leg))
    return False


def _part_lost(shop: MujocoCell, part: str) -> Callable[[], bool]:
    """Says, each time it is asked, whether not all fingers have pressed on a part for a while."""
    held_since = shop.seconds

    def lost() -> bool:
        nonlocal held_since
        if shop.holds(part):
            held_since = shop.seconds
        return shop.seconds - held_since > LOST_S

    return lost


def _let_go(shop: MujocoCell, part: str, carry: Carry, away: PathLeg) -> CarryEnd:
    """Open the hand where the carry ends, and withdraw."""
    world = shop.stage.actual(shop.stage.world)
    reached = world.pose("world", f"{shop.arm}.tool")[:3, 3]
    goal = (carry.T_world_to @ carry.T_part_hand)[:3, 3]
    shop.open_for(carry.grasp.opening)
    shop.permit(part)
    shop.follow(_arm_path(shop, away))
    return CarryEnd.BLOCKED if float(np.linalg.norm(reached - goal)) > SHORT_M else CarryEnd.DONE


def _arm_path(shop: MujocoCell, leg: PathLeg) -> Floats:
    """The path of the arm alone (m, k)."""
    first = shop.stage.world.first_carriers[shop.arm]
    return leg.path[:, first : first + len(shop.q)]


def _go_back(shop: MujocoCell, way_in: Floats) -> None:
    """Back on a way in, from wherever on it the hand stopped."""
    apart = np.abs(way_in - shop.q).max(axis=1)
    last = int(np.argmin(apart))
    shop.follow(np.concatenate([shop.q[None], way_in[: last + 1][::-1]]))
