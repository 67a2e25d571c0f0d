"""A planned carry, carried out: guarded on the way in, and felt all the way. It stops where something is not as planned."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from enum import StrEnum

import numpy as np

from cellwright.engine.model.geometry import Floats
from cellwright.engine.pipelines.placing.answers import Carry, Leg
from cellwright.engine.pipelines.placing.carrying import LIFT_M
from cellwright.engine.pipelines.workshop.inserting import ABOVE_M, inserted, raise_up
from cellwright.engine.pipelines.workshop.shop import Workshop
from cellwright.engine.stages.grasping.insertion import Insertion, Search

GUARD_N = 15.0  # a push that stops the hand on its way to a part
NARROW_M = (
    0.003  # fingers that close farther than this below the part's width hold something else, or nothing
)
LOST_S = 0.05  # a finger may leave a part for less, as when it is set down
WIDER = 2.0  # times what was doubted: a second search
SHORT_M = 0.004  # a hand that stays so far before its goal has met something there


class Went(StrEnum):
    """How a carry ended: the replies of the fault base."""

    DONE = "done"
    TOUCHED = "touched"
    NOT_GRIPPED = "not_gripped"
    LOST = "lost"
    BLOCKED = "blocked"


def carry_out(shop: Workshop, part: str, carry: Carry) -> Went:
    """Take a part and let it go as planned. After a failure the arm is where it can go on from: backed off, and empty."""
    taken = take_up(shop, part, carry)
    return taken if taken is not Went.DONE else put_down(shop, part, carry)


def take_up(shop: Workshop, part: str, carry: Carry) -> Went:
    """Take a part, and carry it to above where it is to go."""
    legs = {leg.what: leg for leg in carry.legs}
    shop.open_for(carry.grasp.opening)
    shop.permit()
    shop.follow(_own(shop, legs["to the part"]))
    way_in = _own(shop, legs["approach"])
    shop.permit(part)
    if not shop.follow(way_in, lambda: shop.push_n() > GUARD_N):
        _back(shop, way_in)
        return Went.TOUCHED
    if shop.close() < carry.grasp.width_m - NARROW_M or not shop.holds(part):
        shop.open_for(carry.grasp.opening)
        _back(shop, way_in)
        return Went.NOT_GRIPPED
    shop.load = part
    return Went.DONE if all(_full(shop, part, legs[name]) for name in ("lift", "carry")) else Went.LOST


def put_down(shop: Workshop, part: str, carry: Carry) -> Went:
    """Let a part go that is held above where it is to go; it is inserted where it is enclosed there."""
    legs = {leg.what: leg for leg in carry.legs}
    if carry.insertion is not None:
        return _put_in(shop, part, carry, legs)
    if not _full(shop, part, legs["lower"]):
        return Went.LOST
    return _let_go(shop, part, carry, legs["withdraw"])


def _put_in(shop: Workshop, part: str, carry: Carry, legs: Mapping[str, Leg]) -> Went:
    """Lower the part to above its hole, and insert it by the sense of force. What does not go in is brought back up."""
    assert carry.insertion is not None
    lower = legs["lower"]
    if not _full(shop, part, replace(lower, path=_above(lower.path, carry.insertion))):
        return Went.LOST
    shop.permit(*shop.scene.cell.bodies)
    if inserted(shop, part, carry):
        return _let_go(shop, part, carry, legs["withdraw"])
    return Went.BLOCKED if shop.holds(part) else _left(shop, lower)


def searched_on(shop: Workshop, part: str, carry: Carry) -> Went:
    """Search for the hole with a part that did not go in, on a spiral that is wider; it is laid down there if this fails, too."""
    legs, plan = {leg.what: leg for leg in carry.legs}, carry.insertion
    if plan is None or not shop.holds(part):
        return _left(shop, legs["lower"])
    wider = replace(plan, search=Search.SPIRAL, doubt_m=WIDER * max(plan.doubt_m, plan.room_m))
    again = replace(carry, insertion=wider)
    raise_up(shop, again)
    if inserted(shop, part, again):
        return _let_go(shop, part, carry, legs["withdraw"])
    return _left(shop, legs["lower"])


def _left(shop: Workshop, lower: Leg) -> Went:
    """The part is left where it is, and the hand backs off."""
    shop.open_wide()
    _back(shop, _own(shop, lower))
    return Went.LOST


def _above(path: Floats, plan: Insertion) -> Floats:
    """The part of a straight way down that ends above the rim; its corners are at even distances."""
    most = max(0.0, 1.0 - (plan.depth_m + ABOVE_M) / LIFT_M) * (len(path) - 1)
    whole = int(most)
    if whole == len(path) - 1:
        return path
    last = path[whole] + (most - whole) * (path[whole + 1] - path[whole])
    return np.concatenate([path[: whole + 1], last[None]])


def _full(shop: Workshop, part: str, leg: Leg) -> bool:
    """Follow a leg with the part in the hand; whether it is still there. What the part stands on may be touched near it."""
    shop.permit(*(shop.scene.cell.bodies if leg.what != "carry" else ()))
    if shop.follow(_own(shop, leg), _lost(shop, part), carries=True):
        return True
    shop.open_wide()
    if leg.what == "lower":
        _back(shop, _own(shop, leg))
    return False


def _lost(shop: Workshop, part: str) -> Callable[[], bool]:
    """Says, each time it is asked, whether not all fingers have pressed on a part for a while."""
    held = shop.seconds

    def lost() -> bool:
        nonlocal held
        if shop.holds(part):
            held = shop.seconds
        return shop.seconds - held > LOST_S

    return lost


def _let_go(shop: Workshop, part: str, carry: Carry, away: Leg) -> Went:
    """Open the hand where the carry ends, and withdraw."""
    world = shop.stage.actual(shop.stage.world)
    reached = world.pose("world", f"{shop.arm}.tool")[:3, 3]
    wanted = (carry.T_world_to @ carry.T_part_hand)[:3, 3]
    shop.open_for(carry.grasp.opening)
    shop.permit(part)
    shop.follow(_own(shop, away))
    return Went.BLOCKED if float(np.linalg.norm(reached - wanted)) > SHORT_M else Went.DONE


def _own(shop: Workshop, leg: Leg) -> Floats:
    """The path of the arm alone (m, k)."""
    first = shop.stage.world.first_carriers[shop.arm]
    return leg.path[:, first : first + len(shop.q)]


def _back(shop: Workshop, way_in: Floats) -> None:
    """Back on a way in, from wherever on it the hand stopped."""
    apart = np.abs(way_in - shop.q).max(axis=1)
    last = int(np.argmin(apart))
    shop.follow(np.concatenate([shop.q[None], way_in[: last + 1][::-1]]))
