"""The legs of a motion: a straight line of the tool out of a place, the way between, a straight line into the next place.

What touches by intention may touch on the straight lines alone, and is proved there pair by pair.
"""

from dataclasses import dataclass

import numpy as np

from engine.kernels.geometry.proof import proved
from engine.kernels.linear import matmul
from engine.model.geometry import Floats
from engine.model.motion import FINEST_M
from engine.pipelines.motion.ends import End
from engine.stages.geometry import transforms
from engine.stages.geometry.collision.ground import Ground
from engine.stages.geometry.reach.hand import ArmHand
from engine.stages.geometry.reach.reach import Reachability
from engine.stages.geometry.reach.straight import Broken, straight
from engine.stages.motion.touching import Touch, touches
from kb.diagnostics import Diagnostic, InvalidInput, Source
from kb.model.cell import Place

LINES = 32  # configurations of a place from which a line is tried
RETRACT, FREE, APPROACH = "retract", "free", "approach"


@dataclass(frozen=True, slots=True, eq=False)
class Leg:
    """A part of a motion: its configurations (m, k), whether it is proved, on what ground, and what touches on it."""

    kind: str
    path: Floats
    proved: bool
    ground: Ground
    margin_m: float = 0.0
    touches: tuple[Touch, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Departures:
    """Where the free part of a motion may begin or end: configurations (n, k) and, for each, the line to it from its place.

    A line is None for an end that has no approach.
    """

    configurations: Floats
    lines: tuple[Floats | None, ...]
    place: Place | None


def departures(end: End, whole: Floats, reach: Reachability, hand: ArmHand, option: str) -> Departures:
    """The straight lines out of a place, from its configurations (n, k), until `LINES` are tried.

    Raises `InvalidInput` if every line breaks, with the reason for the first.
    """
    if end.place is None or end.place.approach_m == 0.0:
        return Departures(whole, (None,) * len(whole), end.place)
    place = end.place
    ground, found, why = Ground(reach.checker(place)), [], ""
    for q in whole[:LINES]:
        T_back = matmul(hand.poses(q[None])[0], transforms.translation(0.0, 0.0, -place.approach_m))
        line = straight(hand, q, T_back)
        if isinstance(line, Broken):
            away = f"{line.share * place.approach_m * 1000:.0f} mm from it"
            why = why or f"the straight line out of {end.name} breaks {away}: {line.why}"
        elif proved(ground.proof(0.0, FINEST_M), line) < len(line) - 1:
            why = why or _what_blocks(ground, line, end.name)
        else:
            found.append(line)
    if not found:
        hint = "give another `approach` or `rpy`, or let the tool turn with `turns: true`"
        raise InvalidInput([Diagnostic(Source(option), "K705", why, hint)])
    return Departures(np.array([line[-1] for line in found]), tuple(found), place)


def _what_blocks(ground: Ground, line: Floats, name: str) -> str:
    proof = ground.proof(0.0, FINEST_M)
    n = proved(proof, line)
    at = line[n] + proof.where * (line[n + 1] - line[n])
    contacts = ground.contacts(at, 0.001)
    said = (
        f"{contacts[0].first} comes too near to {contacts[0].second}" if contacts else "something is too near"
    )
    return f"on the straight line out of {name}, {said}"


def leg_of(kind: str, line: Floats, place: Place, reach: Reachability) -> Leg:
    """The leg of a line out of a place (m, k), or into it, with what touches on it by intention."""
    path = line if kind == RETRACT else line[::-1].copy()
    pairs = touches(Ground.paired(reach.meeting(place)), path, place.depth_m)
    proved_all = all(each.proved for each in pairs)
    return Leg(kind, path, proved_all, Ground(reach.checker(place)), touches=pairs)
