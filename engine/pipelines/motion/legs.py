"""The legs of a motion: a straight line of the tool out of a place, the way between, a straight line into the next place.

What touches by intention may touch on the straight lines alone, and is proved there pair by pair.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from cellwright.engine.kernels.geometry.proof import proved
from cellwright.engine.kernels.linear import matmul
from cellwright.engine.model.geometry import Floats
from cellwright.engine.model.motion import FINEST_M, Answer, Moved, Query
from cellwright.engine.pipelines.motion.ends import End
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.collision.ground import Ground
from cellwright.engine.stages.geometry.reach.hand import ArmHand
from cellwright.engine.stages.geometry.reach.reach import Reachability
from cellwright.engine.stages.geometry.reach.straight import Broken, straight
from cellwright.engine.stages.motion.planner import tried
from cellwright.engine.stages.motion.smoothing import Tube
from cellwright.engine.stages.motion.touching import Touch, touches
from cellwright.engine.stages.motion.upright import Level
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.model.cell import Place

LINES = 32  # configurations of a place from which a line is tried
BETWEEN = 8  # configurations of a line that are looked at between two
FURTHER = 10  # a search after the first one has this part of the budget
RETRACT, FREE, APPROACH = "retract", "free", "approach"


@dataclass(frozen=True, slots=True, eq=False)
class Leg:
    """A part of a motion: its configurations (m, k), whether it is proved, on what ground, and what touches on it.

    The pairs of `meeting` may overlap by `depth_m`.
    """

    kind: str
    path: Floats
    proved: bool
    ground: Ground
    margin_m: float = 0.0
    touches: tuple[Touch, ...] = ()
    meeting: Ground | None = None
    depth_m: float = 0.0

    def tube(self, level: Level | None) -> Tube:
        """What a motion near this path must keep, to be as safe as the path."""
        return Tube(self.ground, self.margin_m, FINEST_M, self.meeting, self.depth_m, level)


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

    Lines on which something that may touch was seen deeper than the place's `depth` are left out, unless there are no others.
    Raises `InvalidInput` if every line breaks, with the reason for the first.
    """
    if end.place is None or end.place.approach_m == 0.0:
        return Departures(whole, (None,) * len(whole), end.place)
    place, ground = end.place, Ground(reach.checker(end.place))
    lines, why = [], ""
    for q in whole[:LINES]:
        line = _line_out(end.name, place, ground, hand, q)
        if isinstance(line, str):
            why = why or line
        else:
            lines.append(line)
    if not lines:
        hint = "give another `approach` or `rpy`, or let the tool turn with `turns: true`"
        raise InvalidInput([Diagnostic(Source(option), "K705", why, hint)])
    meant = reach.shallow(place)
    found = [line for line in lines if not meant.collides(_between(line)).any()] or lines
    return Departures(np.array([line[-1] for line in found]), tuple(found), place)


def _line_out(name: str, place: Place, ground: Ground, hand: ArmHand, q: Floats) -> Floats | str:
    """The straight line (m, k) out of a place from a configuration (k,), or why there is none."""
    T_back = matmul(hand.poses(q[None])[0], transforms.translation(0.0, 0.0, -place.approach_m))
    line = straight(hand, q, T_back)
    if isinstance(line, Broken):
        away = f"{line.share * place.approach_m * 1000:.0f} mm from it"
        return f"the straight line out of {name} breaks {away}: {line.why}"
    if proved(ground.proof(0.0, FINEST_M), line) < len(line) - 1:
        return _what_blocks(ground, line, name)
    return line


def _between(line: Floats) -> Floats:
    """The configurations of a line (m, k), and some between them."""
    shares = np.linspace(0.0, 1.0, BETWEEN)[:, None]
    return np.concatenate([a + shares * (b - a) for a, b in pairwise(line)])


def _meeting(place: Place, reach: Reachability) -> Ground | None:
    """The pairs that may touch at a place; None if there are none."""
    return Ground(reach.meeting(place)) if place.touches else None


def _touched(path: Floats, place: Place, reach: Reachability) -> tuple[Touch, ...]:
    """What touches on a path (m, k) as a place allows, pair by pair."""
    meant = _meeting(place, reach)
    return () if meant is None else touches(meant, path, place.depth_m)


def shallower(answer: Answer, query: Query, place: Place, reach: Reachability, hand: ArmHand) -> Answer:
    """The answer, or one whose path keeps what may touch within the place's `depth`, if the first does not and there is one.

    The first search does not know of depths, because that makes it many times as fast.
    """
    if not isinstance(answer, Moved) or all(each.proved for each in _touched(answer.path, place, reach)):
        return answer
    ground = Ground(reach.shallow(place))
    for finer in (1, 4, 16):
        budget, step = max(1, query.budget // FURTHER), query.step / finer
        again = tried(ground, replace(query, budget=budget, step=step), hand)
        if not isinstance(again, Moved):
            break
        if again.proved and all(each.proved for each in _touched(again.path, place, reach)):
            return again
    return answer


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
    pairs = _touched(path, place, reach)
    proved_all = all(each.proved for each in pairs)
    leg = Leg(kind, path, proved_all, Ground(reach.checker(place)), touches=pairs)
    return replace(leg, meeting=_meeting(place, reach), depth_m=place.depth_m)


def free_leg(blank: Leg, answer: Moved, place: Place, reach: Reachability) -> Leg:
    """The leg of a free path, with what touches on it because an end without a straight line allows it."""
    pairs = _touched(answer.path, place, reach)
    sure = answer.proved and all(each.proved for each in pairs)
    meant = _meeting(place, reach)
    return replace(blank, path=answer.path, proved=sure, touches=pairs, meeting=meant, depth_m=place.depth_m)
