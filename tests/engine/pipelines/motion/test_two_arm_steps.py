"""Two arms at one bench: where they meet, who waits, what they do together, and that no delay
lets them collide.
"""

import random
from collections.abc import Mapping
from functools import lru_cache
from itertools import pairwise

import numpy as np
import pytest

from benchmarks.delay_rehearsal import DelayRehearsal, delayed_begins
from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.model.motion_values import LegKind
from cellwright.engine.model.outcome import Found
from cellwright.engine.model.planning_choices import SequenceChoice
from cellwright.engine.pipelines.motion.arm_conflicts import ArmEncounters
from cellwright.engine.pipelines.motion.arm_conflicts import find_meetings as found_meetings
from cellwright.engine.pipelines.motion.arm_passing import moments_of
from cellwright.engine.pipelines.motion.moving_plan import MovingRun, plan_moving
from cellwright.engine.pipelines.motion.plan_walk import PlanWalk
from cellwright.engine.pipelines.planning.checked_plan import problem_of
from cellwright.engine.pipelines.planning.plan_gate import PlanGate
from cellwright.engine.pipelines.planning.plan_objective import plan_for_objective
from cellwright.engine.plugins import geometry_backend
from cellwright.engine.stages.geometry.world.geometric_world import (
    GeometricWorld,
    world_after_facts,
)
from cellwright.engine.stages.planning import SearchLimits
from cellwright.kb.loader.cell import cell_of
from cellwright.kb.model.plan_model import Plan, StepId


@lru_cache
def moving(name: str) -> MovingRun:
    """The plan that moves for a problem of the bench."""
    target = f"dual/{name}"
    backend = geometry_backend()
    return plan_moving(
        problem_of(target, "", ""),
        cell_of(target),
        backend,
        lambda p: plan_for_objective(p, SearchLimits(), None, SequenceChoice.SEQUENCE),
    )


def steps_of(made: MovingRun) -> Plan:
    assert isinstance(made.run.outcome, Found)
    return made.run.outcome.plan


def test_arms_on_their_own_sides_work_at_once() -> None:
    made = moving("both_sides")
    assert made.sharing is not None
    assert not made.sharing.zones
    assert made.sharing.apart == 4


def test_arms_in_the_middle_share_a_zone_and_one_waits() -> None:
    made = moving("crossing")
    assert made.sharing is not None
    assert made.sharing.zones
    assert set(made.sharing.zones[0].steps) == {"left", "right"}
    assert made.sharing.ordered > 0


@pytest.mark.parametrize(
    ("name", "late_s"),
    [
        ("crossing", 0.0),
        ("crossing", 3.0),
        ("scanned", 3.0),
        pytest.param("bench", 6.0, marks=pytest.mark.slow),
    ],
)
def test_no_delay_lets_the_arms_collide(name: str, late_s: float) -> None:
    made, drawn = moving(name), random.Random(3)
    found = steps_of(made)
    semantics, backend = PlanGate().semantics(made.problem), geometry_backend()
    walk, encounters = PlanWalk(semantics, cell_of(f"dual/{name}"), backend), ArmEncounters(backend)
    rehearsal = DelayRehearsal(moments_of(walk, found, made.steps), encounters)
    for _ in range(3):
        late = {step.id: drawn.uniform(0.0, late_s) for step in found.steps}
        starts, last = delayed_begins(found, made.steps, 1.0, late)
        looked = rehearsal.seen(starts, last, step=0.01)
        assert looked.moments > looked.looks > 0
        assert looked.least_m > 0.0


def test_where_an_arm_rests_after_a_step_of_both_is_looked_at() -> None:
    made = moving("bench")
    backend = geometry_backend()
    walk = PlanWalk(PlanGate().semantics(made.problem), cell_of("dual/bench"), backend)
    moments = moments_of(walk, steps_of(made), made.steps)
    joint = {each.step for each in moments if len(each.arms) > 1}
    rests = found_meetings(moments, frozenset(), ArmEncounters(backend)).meetings.rests
    assert any(after in joint for _, after, _ in rests)


def test_without_the_orders_the_arms_would_collide() -> None:
    made = moving("crossing")
    found = steps_of(made)
    backend = geometry_backend()
    walk, encounters = (
        PlanWalk(PlanGate().semantics(made.problem), cell_of("dual/crossing"), backend),
        ArmEncounters(backend),
    )
    moments = moments_of(walk, found, made.steps)
    own, starts = dict[str, float](), {}
    for each in moments:
        assert each.moved is not None
        arm = each.arms[0]
        starts[each.step] = own.get(arm, 0.0)
        own[arm] = starts[each.step] + each.moved.seconds
    looked = DelayRehearsal(moments, encounters).seen(starts, max(own.values()), step=0.01)
    assert looked.least_m <= 0.0


def test_a_rod_is_in_the_second_hand_before_the_first_leaves() -> None:
    made = moving("over")
    step = next(each for each in made.steps if each.operator.name == "hand_over")
    kinds = [(leg.arm, leg.kind) for leg in step.legs]
    assert kinds.index(("right", LegKind.IN)) < kinds.index(("left", LegKind.OUT))
    assert step.proved


def test_each_hand_keeps_its_pose_on_the_beam() -> None:
    made = moving("carried")
    carry = next(leg for leg in made.steps[0].legs if leg.kind is LegKind.CARRY)
    (other,) = carry.beside
    world = world_after_facts(
        GeometricWorld.of(cell_of("dual/carried")), PlanGate().semantics(made.problem).initial()
    )
    first = None
    for t in np.linspace(0.0, carry.seconds, 200):
        now = world.moved(carry.arm, carry.at(t)).moved(other.arm, other.at(t))
        T = now.pose(f"{carry.arm}.tool", f"{other.arm}.tool")
        first = T if first is None else first
        assert np.linalg.norm(T[:3, 3] - first[:3, 3]) < 1e-3
        assert np.abs(T[:3, :3] - first[:3, :3]).max() < 5e-3


def test_an_arm_that_holds_on_stays_where_it_holds() -> None:
    made = moving("scanned")
    step = next(each for each in made.steps if each.operator.name == "scan")
    holder = [leg.kind for leg in step.legs if leg.arm == "left"]
    assert LegKind.OUT not in holder


def test_stretches_decided_by_one_look_say_what_a_look_at_each_moment_says() -> None:
    for name in ("crossing", "scanned"):
        made, drawn = moving(name), random.Random(5)
        found, backend = steps_of(made), geometry_backend()
        walk, encounters = (
            PlanWalk(PlanGate().semantics(made.problem), cell_of(f"dual/{name}"), backend),
            ArmEncounters(backend),
        )
        rehearsal = DelayRehearsal(moments_of(walk, found, made.steps), encounters)
        late = {step.id: drawn.uniform(0.0, 4.0) for step in found.steps}
        starts, last = delayed_begins(found, made.steps, 1.0, late)
        looked = rehearsal.seen(starts, last, step=0.02)
        moments, least = _looked_one_by_one(rehearsal, starts, last, 0.02)
        assert looked.moments == moments
        assert looked.least_m == pytest.approx(least, abs=1e-9)


def _looked_one_by_one(
    rehearsal: DelayRehearsal, starts: Mapping[StepId, float], until_s: float, step: float
) -> tuple[int, float]:
    """How many moments there are, and how near the arms come, by a look at each; where an arm
    is, its legs say.
    """
    left, right = (rehearsal.courses[arm].begun(starts, until_s) for arm in ("left", "right"))
    cuts = sorted({*left.begins_s.tolist(), *right.begins_s.tolist(), until_s})
    count, least = 0, 1.0
    for begins, ends in pairwise(cuts):
        (a,), (b,) = (each.line_at(np.array([(begins + ends) / 2])) for each in (left, right))
        if left.step[a] and left.step[a] == right.step[b]:
            continue
        speed = max(left.speeds[a], right.speeds[b])
        times = np.linspace(begins, ends, int(np.ceil((ends - begins) * speed / step)) + 2)
        riders = left.riders[left.rider[a]], right.riders[right.rider[b]]
        mine, theirs = (
            np.array([_configuration(rehearsal, arm, starts, t) for t in times])
            for arm in ("left", "right")
        )
        still = np.zeros_like(mine)
        clear, _ = rehearsal.encounters.apart((riders[0], mine, still), (riders[1], theirs, still))
        count, least = count + len(times), min(least, float(clear.min()))
    return count, least


def _configuration(
    rehearsal: DelayRehearsal, arm: str, starts: Mapping[StepId, float], t: float
) -> Floats:
    """Where an arm is at a time, leg by leg."""
    q: Floats = rehearsal.moments[0].before.configurations[arm]
    for moment in sorted(rehearsal.moments, key=lambda each: starts[each.step]):
        assert moment.moved is not None
        now, entered = starts[moment.step], False
        for leg in moment.moved.legs:
            own = next((each for each in (leg, *leg.beside) if each.arm == arm), None)
            if t < now:
                return q
            if own is not None:
                q = own.at(min(t - now, leg.seconds))
            now += leg.seconds
            if leg.kind is LegKind.IN and not entered:
                entered, now = True, now + moment.moved.takes_s
    return q
