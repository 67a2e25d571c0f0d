"""Which arm goes first where arms meet, for the least makespan (CP-SAT).

An arm that rests in the way of another one is in the way until it has taken its next step. So where
the place between two steps meets a step of another arm, that step comes before both of them, or
after both. What no schedule has brought together so far is left out, and added when one does.
"""

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from ortools.sat.python import cp_model
from ortools.sat.python.cp_model import CpModel

from cellwright.engine.model.motion_values import Meetings, PassingOrder, StepPair
from cellwright.engine.model.outcome import Infeasible
from cellwright.engine.stages.scheduling.schedule_limits import ScheduleLimits
from cellwright.engine.stages.scheduling.shop_solver import run_solver
from cellwright.kb.model.plan_model import StepId

BLOCKED_REASON = "whichever arm goes first, one rests in the way of another"
MAX_STAY_ROUNDS = 400


@dataclass(frozen=True)
class Crossing:
    """What is asked: steps with their durations, in an order that can be executed; pairs that are
    in order; where arms meet.

    No step begins before its `release`.
    """

    durations: Mapping[StepId, int]
    before: frozenset[StepPair]
    meetings: Meetings
    release: Mapping[StepId, int] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class _Stay:
    """An arm is in the way of the step `other` from the start of its step `first` to the end of
    `last`.

    None for `first`: from the beginning. None for `last`: to the end.
    """

    first: StepId | None
    last: StepId | None
    other: StepId


def schedule_crossing(asked: Crossing, limits: ScheduleLimits) -> PassingOrder | Infeasible | None:
    """The schedule with the least makespan that is found; None if none was found within the
    limits.
    """
    before = asked.before | asked.meetings.orders | frozenset(_in_turn(asked.meetings))
    stays = sorted(
        set(_arm_stays(asked.meetings)),
        key=lambda arm_stay: (arm_stay.other, arm_stay.first or 0, arm_stay.last or 0),
    )
    chosen = [stay for stay in stays if stay.first is None or stay.last is None]
    for _ in range(MAX_STAY_ROUNDS):
        crossing = _solve_crossing(asked, before, chosen, limits)
        if not isinstance(crossing, PassingOrder):
            return crossing
        clashing = [stay for stay in stays if _stay_clashes(stay, asked.durations, crossing.starts)]
        if not clashing:
            return _settle_crossing(asked, before, stays, crossing)
        chosen += clashing
    return None


def _in_turn(meetings: Meetings) -> Iterator[StepPair]:
    """Each arm takes its steps in their order."""
    for track in meetings.tracks.values():
        yield from itertools.pairwise(track)


def _arm_stays(meetings: Meetings) -> Iterator[_Stay]:
    """For which steps an arm is in the way, on its way or at rest."""
    for first, second in meetings.steps:
        yield _Stay(first, first, second)
    for arm, after, other in meetings.rests:
        track = meetings.tracks[arm]
        at = -1 if after is None else track.index(after)
        yield _Stay(after, track[at + 1] if at + 1 < len(track) else None, other)


def _stay_clashes(
    stay: _Stay, durations: Mapping[StepId, int], starts: Mapping[StepId, int]
) -> bool:
    """Whether a step is under way while an arm is in its way."""
    begins, ends = starts[stay.other], starts[stay.other] + durations[stay.other]
    late = stay.last is None or begins < starts[stay.last] + durations[stay.last]
    early = stay.first is None or ends > starts[stay.first]
    return late and early


def _solve_crossing(
    asked: Crossing, before: frozenset[StepPair], stays: list[_Stay], limits: ScheduleLimits
) -> PassingOrder | Infeasible | None:
    """The best schedule in which no arm is in the way during some stays."""
    cp, lasts = CpModel(), asked.durations
    horizon = sum(lasts.values()) + max(asked.release.values(), default=0)
    starts = {n: cp.new_int_var(asked.release.get(n, 0), horizon, "") for n in lasts}
    makespan = cp.new_int_var(0, horizon, "makespan")
    for earlier, later in sorted(before):
        cp.add(starts[later] >= starts[earlier] + lasts[earlier])
    for n, start in starts.items():
        cp.add(makespan >= start + lasts[n])
    for stay in stays:
        after = cp.new_bool_var("")
        if stay.last is None:
            cp.add(after == 0)
        else:
            cp.add(starts[stay.other] >= starts[stay.last] + lasts[stay.last]).only_enforce_if(
                after
            )
        if stay.first is None:
            cp.add(after == 1)
        else:
            cp.add(starts[stay.first] >= starts[stay.other] + lasts[stay.other]).only_enforce_if(
                ~after
            )
    cp.minimize(makespan)
    solver = cp_model.CpSolver()
    status = run_solver(solver, cp, limits)
    if status == cp_model.INFEASIBLE:
        return Infeasible(BLOCKED_REASON)
    if status not in (cp_model.OPTIMAL, cp_model.FEASIBLE):
        return None
    bound = round(solver.best_objective_bound)
    times = {n: solver.value(start) for n, start in starts.items()}
    return PassingOrder(times, solver.value(makespan), bound, proved=status == cp_model.OPTIMAL)


def _settle_crossing(
    asked: Crossing, before: frozenset[StepPair], stays: list[_Stay], crossing: PassingOrder
) -> PassingOrder:
    """The schedule with every step as early as its order allows, and the orders that keep the
    arms apart.
    """
    starts, orders = crossing.starts, set[StepPair]()
    for stay in stays:
        if (
            stay.last is not None
            and starts[stay.other] >= starts[stay.last] + asked.durations[stay.last]
        ):
            orders.add((stay.last, stay.other))
        elif stay.first is not None:
            orders.add((stay.other, stay.first))
    waits: dict[StepId, list[StepId]] = {n: [] for n in asked.durations}
    for earlier, later in before | orders:
        waits[later].append(earlier)
    soonest = dict[StepId, int]()
    for n in sorted(
        waits,
        key=lambda step_number: (
            starts[step_number],
            starts[step_number] + asked.durations[step_number],
        ),
    ):
        ends = (soonest[wait] + asked.durations[wait] for wait in waits[n])
        soonest[n] = max([asked.release.get(n, 0), *ends])
    last = max((start + asked.durations[n] for n, start in soonest.items()), default=0)
    held = frozenset(orders) - before
    return PassingOrder(soonest, last, min(crossing.lower_bound, last), held, crossing.proved)
