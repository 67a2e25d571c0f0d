"""Timetables of single steps: in the order of the plan, or in the best of all their orders.

That is for plans that cannot be cut into blocks: whatever the arms do at the start, and whatever a
step moves.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

from cellwright.engine.kernels.bits import Bits, indices
from cellwright.engine.model.ground_task import GroundOperator, GroundTask
from cellwright.engine.model.outcome import Infeasible
from cellwright.engine.model.plan_times import earliest_starts, plan_makespan
from cellwright.engine.model.shop_scheduling import (
    Resource,
    Schedule,
    Shop,
    ShopJob,
    ShopStage,
    Timetable,
)
from cellwright.engine.pipelines.planning.plan_gate import PlanGate
from cellwright.engine.pipelines.planning.timetable.alternative_means import alternative_operators
from cellwright.engine.pipelines.planning.window_keeping import lags_of_plan
from cellwright.engine.stages.planning.improvement.plan_reordering import deorder_steps
from cellwright.engine.stages.scheduling import ScheduleLimits
from cellwright.engine.stages.scheduling.plan_blocks import (
    Unstructured,
    arm_resource,
    contains_term,
)
from cellwright.engine.stages.scheduling.shop_translation import Wishes
from cellwright.engine.stages.scheduling.window_lags import StepLag
from cellwright.kb.model.plan_model import Plan, Step, StepId
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Term

if TYPE_CHECKING:
    from cellwright.engine.stages.scheduling.step_ordering import Reordered

SCOPE_ORDERS = "of all orders of these steps"
SCOPE_CHOICES = "of all ways to do these steps, also by other means"
SCOPE_ALL_PLANS = "of all plans"
ORDERING_WORK_S = 2.0  # of the work of the solver at most, and a sixth: units of it are larger here
MAX_POOLED_STEPS = 120  # steps among which the best are chosen
MAX_BOUNDED_OPERATORS = 5_000  # operators of a task, all of whose plans are bounded


@dataclass(frozen=True)
class TimedSteps:
    """The steps of a plan as plain operators, in its order, from the initial state of the task
    to `goals`.
    """

    problem: Problem
    task: GroundTask
    plan: Plan
    operators: Sequence[GroundOperator]
    goals: Bits
    wishes: Wishes

    def in_best_order(
        self, gate: PlanGate, limits: ScheduleLimits, note: str
    ) -> Timetable | Infeasible | None:
        """The timetable of the best order that is found; None if the order of the plan is all
        that there is.
        """
        last = plan_makespan(self.plan)
        if not self.wishes.any and last == self.bound:
            return in_its_order(self.problem, self.plan, note, self.bound)
        share = replace(limits, work=min(limits.work / 6, ORDERING_WORK_S))
        reordered = self._reordered(self.bound, share)
        if reordered is None or isinstance(reordered, Infeasible):
            return reordered
        if not self.wishes.any and reordered.makespan >= last:
            least = last if reordered.proved else reordered.lower_bound
            return in_its_order(self.problem, self.plan, note, least)
        return self._arranged(gate, reordered, note, SCOPE_ORDERS)

    def in_best_choice(
        self, gate: PlanGate, more: Sequence[GroundOperator], limits: ScheduleLimits, bound: int
    ) -> Timetable | None:
        """The timetable of the best choice of these and `more` steps, also by other means; None
        if there are no such.
        """
        if not any(alternative_operators(self.task, self.operators, self.goals)):
            return None
        steps = (*self.operators, *more)
        other_operators = tuple(alternative_operators(self.task, steps, self.goals))
        if len(steps) + len(other_operators) > MAX_POOLED_STEPS:
            return None
        pool = replace(self, operators=(*steps, *other_operators))
        reordered = pool._reordered(bound, limits, optional=True)
        if reordered is None or isinstance(reordered, Infeasible):
            return None
        return pool._arranged(gate, reordered, "", SCOPE_CHOICES)

    def _arranged(
        self, gate: PlanGate, reordered: "Reordered", note: str, scope: str
    ) -> Timetable | None:
        """What the solver found as a plan that the checker accepts; None if it does not."""
        order = list(reordered.starts)
        steps, times = [self.operators[n] for n in order], [reordered.starts[n] for n in order]
        plan = deorder_steps(self.task, steps, self.goals, times)
        if gate.findings(self.problem, plan):
            return None
        starts = dict(zip((step.id for step in plan.steps), times, strict=True))
        schedule = Schedule(
            {}, (), reordered.makespan, reordered.lower_bound, reordered.tardiness, reordered.proved
        )
        return by_step(self.problem, plan, starts, schedule, note, scope)

    def _reordered(
        self, bound: int, limits: ScheduleLimits, optional: bool = False
    ) -> "Reordered | Infeasible | None":
        from cellwright.engine.stages.scheduling.step_ordering import (
            StepOrdering,
            TooManySupports,
            reorder_steps,
        )

        asked = StepOrdering(
            self.task.initial,
            self.operators,
            self.goals,
            self._horizon,
            self._lead,
            self._stays,
            self._by_step(self.wishes.release),
            tuple(self._due()),
            self.lags,
            self.wishes.calendars,
            optional,
        )
        own = earliest_starts(self.plan)
        own_starts = {n: own[step.id] for n, step in enumerate(self.plan.steps)}
        try:
            return reorder_steps(asked, bound, own_starts, limits)
        except TooManySupports:
            return None

    @cached_property
    def bound(self) -> int:
        """No order of the steps ends before this: what each resource must do, and the longest
        way to each step.
        """
        loads: Counter[Term] = Counter()
        for step in self.operators:
            for resource in step.resources:
                loads[resource] += step.duration
        return max([0, *loads.values(), *_soonest_times(self.task.initial, self.operators)[1]])

    @cached_property
    def lags(self) -> list[StepLag]:
        """The windows between the steps, those that have several events in the plan's order."""
        if not self.wishes.between:
            return []
        numbered = enumerate(self.operators, 1)
        steps = (
            Step(StepId(n), each.instance, (), each.resources, each.duration, each.cost)
            for n, each in numbered
        )
        return lags_of_plan(self.problem, Plan(tuple(steps)))

    @property
    def _horizon(self) -> int:
        trips = max(self.wishes.travel.values(), default=0) * (len(self.operators) + 1)
        last = trips + max(self.wishes.release.values(), default=0)
        if not self.wishes.between and not self.wishes.calendars:
            return last + plan_makespan(self.plan)
        last += sum(step.duration for step in self.operators) + sum(lag.least for lag in self.lags)
        return max([last, *(each.horizon(last) for each in self.wishes.calendars)])

    @cached_property
    def _arm(self) -> Term | None:
        try:
            return arm_resource(self.operators)
        except Unstructured:
            return None

    @cached_property
    def _places(self) -> list[Term | None]:
        arm = self._arm
        return [
            None if arm is None else self.wishes.place(step.instance, step.resources, arm)
            for step in self.operators
        ]

    def _lead(self, first: int, second: int) -> int:
        """How long the arm travels from one step to another that it does as well."""
        place_before, place_after = self._places[first], self._places[second]
        both = all(self._arm in self.operators[n].resources for n in (first, second))
        return (
            self.wishes.travel.get((place_before, place_after), 0)
            if both and place_before and place_after
            else 0
        )

    @property
    def _stays(self) -> dict[int, int]:
        """How long each condition may last that says that something is in a place."""
        longest: dict[int, int] = {}
        for place, most in self.wishes.longest_stay.items():
            for number, atom in enumerate(self.task.atoms):
                inside = [contains_term(argument, place) for argument in atom.arguments]
                if any(inside) and not all(inside) and atom.name != "not":
                    longest[number] = min(most, longest.get(number, most))
        return longest

    def _about(self, subject: Term) -> list[int]:
        return [n for n, step in enumerate(self.operators) if contains_term(step.instance, subject)]

    def _by_step(self, wished: Mapping[Term, int]) -> dict[int, int]:
        starts_by_step: dict[int, int] = {}
        for subject, value in wished.items():
            for n in self._about(subject):
                starts_by_step[n] = max(value, starts_by_step.get(n, 0))
        return starts_by_step

    def _due(self) -> list[tuple[Sequence[int], int, int]]:
        wishes = self.wishes
        return [(self._about(s), due, wishes.priority.get(s, 1)) for s, due in wishes.due.items()]


def least_makespan(task: GroundTask) -> int:
    """No plan of a task is shorter; 0 if the task is too large to be asked, leaves something
    out, or has derived atoms.
    """
    if len(task.operators) > MAX_BOUNDED_OPERATORS or not task.whole or task.axioms:
        return 0
    times, _ = _soonest_times(task.initial, task.operators)
    ways = [[times.get(atom, 0) for atom in indices(goal)] for goal in task.goals]
    return min((max(arrival_times, default=0) for arrival_times in ways), default=0)


def _soonest_times(
    initial: Bits, steps: Sequence[GroundOperator]
) -> tuple[dict[int, int], list[int]]:
    """When each condition can hold and each step have ended at the soonest, if nothing that was
    achieved ended again.
    """
    times: dict[int, int] = dict.fromkeys(indices(initial), 0)
    ends: dict[int, int] = {}
    changed = True
    while changed:
        changed = False
        for n, step in enumerate(steps):
            needed = [times.get(atom) for atom in indices(step.preconditions)]
            known_times = [time_needed for time_needed in needed if time_needed is not None]
            if len(known_times) < len(needed):
                continue
            end = max(known_times, default=0) + step.duration
            if end < ends.get(n, end + 1):
                ends[n], changed = end, True
                for atom in indices(step.adds):
                    times[atom] = min(end, times.get(atom, end))
    return times, list(ends.values())


def in_its_order(problem: Problem, plan: Plan, note: str = "", bound: int = 0) -> Timetable:
    """The plan with every step as early as its own order allows; no order of its steps ends
    before `bound`.
    """
    last = plan_makespan(plan)
    return by_step(
        problem, plan, earliest_starts(plan), Schedule({}, (), last, bound, 0, bound == last), note
    )


def by_step(
    problem: Problem,
    plan: Plan,
    starts: Mapping[StepId, int],
    schedule: Schedule,
    note: str,
    scope: str = SCOPE_ORDERS,
) -> Timetable:
    """A timetable with a stage for each step; steps of one object, one after another, are a job."""
    stages = {
        step.id: ShopStage(
            f"{step.id} {step.operator}", step.duration, tuple(map(str, step.resources))
        )
        for step in plan.steps
    }
    jobs = tuple(
        ShopJob(name, tuple(stages[step.id] for step in steps))
        for name, steps in _jobs_of_plan(problem, plan, starts)
    )
    resources = dict.fromkeys(str(resource) for step in plan.steps for resource in step.resources)
    bare = Shop(jobs, tuple(map(Resource, resources)))
    windows = tuple(
        bare.after(stages[a].name, stages[s.id].name) for s in plan.steps for a in s.after
    )
    times = {stages[step].name: start for step, start in starts.items()}
    schedule_by_step = replace(schedule, starts=times)
    return Timetable(plan, starts, replace(bare, windows=windows), schedule_by_step, scope, note)


def _jobs_of_plan(
    problem: Problem, plan: Plan, starts: Mapping[StepId, int]
) -> list[tuple[str, list[Step]]]:
    """The steps by the object of the workflow that they alone serve; other steps are jobs of
    their own.
    """
    subjects = tuple(dict.fromkeys(c.subject for c in problem.chains if c.subject is not None))
    jobs: dict[str, list[Step]] = {}
    for step in sorted(plan.steps, key=lambda step_entry: (starts[step_entry.id], step_entry.id)):
        served = [str(subject) for subject in subjects if contains_term(step.operator, subject)]
        name = served[0] if len(served) == 1 else f"{step.id} {step.operator}"
        before = jobs.setdefault(name, [])
        if before and starts[before[-1].id] + before[-1].duration > starts[step.id]:
            jobs[f"{step.id} {step.operator}"] = [step]
        else:
            before.append(step)
    return list(jobs.items())
