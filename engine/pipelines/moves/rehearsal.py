"""A plan of several arms with delays: when each arm is where, and what looks at all of it, not at proofs, find in collision.

Steps begin as soon as those that they wait for have ended, each as late as is asked. Then the arms are looked at from moment to
moment. It shares with the proof of the plan (`meetings`) only what an arm is and what is a collision.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from engine.model.geometry import Floats
from engine.model.moves import Leg, LegKind, MovedStep
from engine.pipelines.moves.meetings import Encounters
from engine.pipelines.moves.tracks import Moment, Occupied, Passage, tracks
from engine.stages.geometry.collision.swept import crossed
from kb.model.plan import Plan, StepId

CHECKING = 1 / 32  # rad or m: how often the planner of motions looks


@dataclass(frozen=True, slots=True, eq=False)
class Stretch:
    """From one time to another (s) an arm goes along a leg, or rests where its passage ends; `step` is None between steps."""

    arm: str
    begins_s: float
    ends_s: float
    passage: Passage
    step: StepId | None
    leg: Leg | None = None

    def at(self, times: Floats) -> Floats:
        """The configurations (n, k) at times (n,) from the beginning of the plan."""
        if self.leg is None:
            return np.repeat(self.passage.path[-1:], len(times), axis=0)
        found: Floats = np.array([self.leg.at(float(t) - self.begins_s) for t in times])
        return found

    @property
    def speed(self) -> float:
        """The greatest speed of a joint at most: 15/8 of the mean on a line that is gone through from rest to rest."""
        if self.leg is None or len(self.leg.path) < 2:
            return 0.0
        lasts = np.maximum(np.diff(self.leg.corners_s), 1e-9)
        return float((np.abs(np.diff(self.leg.path, axis=0)).max(axis=1) / lasts).max()) * 15 / 8


@dataclass(frozen=True, slots=True)
class Seen:
    """What was looked at: how many moments, and how near two arms came at the least (m; as far as was looked)."""

    looks: int
    least_m: float


def delayed(
    plan: Plan, steps: Sequence[MovedStep], unit_s: float, late_s: Mapping[StepId, float]
) -> tuple[dict[StepId, float], float]:
    """When each step begins (s), if each is so late, and when all is done."""
    lasts = {each.step: each.seconds for each in steps}
    starts, ends = dict[StepId, float](), dict[StepId, float]()
    for step in plan.steps:
        soonest = max((ends[one] for one in step.after), default=0.0)
        starts[step.id] = soonest + late_s.get(step.id, 0.0)
        ends[step.id] = starts[step.id] + lasts.get(step.id, step.duration * unit_s)
    return starts, max(ends.values(), default=0.0)


def stretches(
    moments: Sequence[Moment], starts: Mapping[StepId, float], until_s: float
) -> dict[str, list[Stretch]]:
    """For each arm where it is from the beginning to the end."""
    homes = moments[0].before.configurations if moments else {}
    moved = {each.step: each.moved for each in moments}
    found: dict[str, list[Stretch]] = {}
    for arm, track in tracks(moments, homes).items():
        now, own = 0.0, list[Stretch]()
        for each in track:
            done = moved[each.step]
            assert done is not None
            if starts[each.step] > now:
                last = own[-1].passage if own else each.passages[0]
                own.append(Stretch(arm, now, starts[each.step], last, None))
            own += _of_step(each, done, starts[each.step])
            now = own[-1].ends_s
            own.append(Stretch(arm, now, now, each.rest, None))
        if own:
            own.append(Stretch(arm, now, until_s, own[-1].passage, None))
        found[arm] = own
    return found


def _of_step(occupied: Occupied, moved: MovedStep, begins_s: float) -> Iterator[Stretch]:
    """What one arm does in a step, one leg after the other; it rests while another arm moves."""
    now, passages = begins_s, list(occupied.passages)
    at = passages.pop(0)
    for leg in moved.legs:
        lasts = moved.takes_s if leg.kind is LegKind.DRIVE else leg.seconds
        own = next((each for each in (leg, *leg.beside) if each.arm == occupied.arm), None)
        at = passages.pop(0) if own is not None else at
        yield Stretch(occupied.arm, now, now + lasts, at, occupied.step, own)
        now += lasts
        if leg.kind is LegKind.IN and leg is next(x for x in moved.legs if x.kind is LegKind.IN):
            yield Stretch(occupied.arm, now, now + moved.takes_s, at, occupied.step)
            now += moved.takes_s


def seen(found: Mapping[str, list[Stretch]], encounters: Encounters, step: float = CHECKING / 100) -> Seen:
    """Look at all arms so often that no joint moves by more than `step` (rad, m) between two looks.

    Where the boxes around what two arms sweep keep apart, there is nothing to be seen. Arms in one step are left out: their contact is
    meant, and proved when the step is planned.
    """
    looks, least = 0, np.inf
    for first, second in combinations(found, 2):
        for a in found[first]:
            for b in found[second]:
                begins, ends = max(a.begins_s, b.begins_s), min(a.ends_s, b.ends_s)
                same = a.step is not None and a.step == b.step
                if ends <= begins or same:
                    continue
                if not len(crossed(encounters.boxes(a.passage), encounters.boxes(b.passage))):
                    continue
                count = int(np.ceil((ends - begins) * max(a.speed, b.speed) / step)) + 2
                times = np.linspace(begins, ends, count)
                least = min(least, encounters.clearance(a.passage, a.at(times), b.passage, b.at(times)))
                looks += count
    return Seen(looks, float(least))
