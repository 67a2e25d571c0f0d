"""Timetables of single steps: in the order of the plan, or in the best of all their orders.

That is for plans that cannot be cut into blocks: whatever the arms do at the start, and whatever a step moves.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

from cellwright.engine.model.forecast import earliest_starts, makespan
from cellwright.engine.model.outcome import Infeasible
from cellwright.engine.model.schedule import Schedule, Timetable
from cellwright.engine.model.shop import Job, Resource, Shop, Stage
from cellwright.engine.model.task import Bits, GroundOperator, Task, indices
from cellwright.engine.pipelines.gate import PlanGate
from cellwright.engine.pipelines.timetable.alternatives import alternatives
from cellwright.engine.stages.planning.improvement.deorder import deorder
from cellwright.engine.stages.scheduling import ScheduleLimits
from cellwright.engine.stages.scheduling.blocks import Unstructured, arm_of, mentions
from cellwright.engine.stages.scheduling.work import Wishes
from cellwright.kb.model.plan import Plan, Step, StepId
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import Term

if TYPE_CHECKING:
    from cellwright.engine.stages.scheduling.reorder import Reordered

ORDERS = "of all orders of these steps"
CHOICES = "of all ways to do these steps, also by other means"
ORDERING = 2.0  # of the work of the solver at most, and a sixth: units of it are larger here
POOL = 120  # steps among which the best are chosen
MOST = 5_000  # operators of a task, all of whose plans are bounded


@dataclass(frozen=True)
class Steps:
    """The steps of a plan as plain operators, in its order, from the initial state of the task to `goals`."""

    problem: Problem
    task: Task
    plan: Plan
    operators: Sequence[GroundOperator]
    goals: Bits
    wishes: Wishes

    def in_best_order(
        self, gate: PlanGate, limits: ScheduleLimits, note: str
    ) -> Timetable | Infeasible | None:
        """The timetable of the best order that is found; None if the order of the plan is all that there is."""
        last = makespan(self.plan)
        if not self.wishes.any and last == self.bound:
            return in_its_order(self.problem, self.plan, note, self.bound)
        share = replace(limits, work=min(limits.work / 6, ORDERING))
        found = self._reordered(self.bound, share)
        if found is None or isinstance(found, Infeasible):
            return found
        if not self.wishes.any and found.makespan >= last:
            least = last if found.proved else found.lower_bound
            return in_its_order(self.problem, self.plan, note, least)
        return self._arranged(gate, found, note, ORDERS)

    def in_best_choice(
        self, gate: PlanGate, more: Sequence[GroundOperator], limits: ScheduleLimits, bound: int
    ) -> Timetable | None:
        """The timetable of the best choice of these and `more` steps, also by other means; None if there are no such."""
        if not any(alternatives(self.task, self.operators, self.goals)):
            return None
        steps = (*self.operators, *more)
        others = tuple(alternatives(self.task, steps, self.goals))
        if len(steps) + len(others) > POOL:
            return None
        pool = replace(self, operators=(*steps, *others))
        found = pool._reordered(bound, limits, optional=True)
        if found is None or isinstance(found, Infeasible):
            return None
        return pool._arranged(gate, found, "", CHOICES)

    def _arranged(self, gate: PlanGate, found: "Reordered", note: str, scope: str) -> Timetable | None:
        """What the solver found as a plan that the checker accepts; None if it does not."""
        order = list(found.starts)
        steps, times = [self.operators[n] for n in order], [found.starts[n] for n in order]
        plan = deorder(self.task, steps, self.goals, times)
        if gate.findings(self.problem, plan):
            return None
        starts = dict(zip((step.id for step in plan.steps), times, strict=True))
        made = Schedule({}, (), found.makespan, found.lower_bound, found.tardiness, found.proved)
        return by_step(self.problem, plan, starts, made, note, scope)

    def _reordered(
        self, bound: int, limits: ScheduleLimits, optional: bool = False
    ) -> "Reordered | Infeasible | None":
        from cellwright.engine.stages.scheduling.orders import (  # the solver takes a while to load
            Ordering,
            TooLarge,
        )
        from cellwright.engine.stages.scheduling.reorder import reordered

        asked = Ordering(
            self.task.initial,
            self.operators,
            self.goals,
            self._horizon,
            self._lead,
            self._stays,
            self._by_step(self.wishes.release),
            tuple(self._due()),
            optional,
        )
        own = earliest_starts(self.plan)
        known = {n: own[step.id] for n, step in enumerate(self.plan.steps)}
        try:
            return reordered(asked, bound, known, limits)
        except TooLarge:
            return None

    @cached_property
    def bound(self) -> int:
        """No order of the steps ends before this: what each resource must do, and the longest way to each step."""
        loads: Counter[Term] = Counter()
        for step in self.operators:
            for resource in step.resources:
                loads[resource] += step.duration
        return max([0, *loads.values(), *_soonest(self.task.initial, self.operators)[1]])

    @property
    def _horizon(self) -> int:
        trips = max(self.wishes.travel.values(), default=0) * (len(self.operators) + 1)
        return makespan(self.plan) + trips + max(self.wishes.release.values(), default=0)

    @cached_property
    def _arm(self) -> Term | None:
        try:
            return arm_of(self.operators)
        except Unstructured:
            return None

    @cached_property
    def _places(self) -> list[Term | None]:
        arm = self._arm
        return [
            None if arm is None else self.wishes.place(step.instance, step.resources, arm)
            for step in self.operators
        ]

    def _lead(self, one: int, other: int) -> int:
        """How long the arm travels from one step to another that it does as well."""
        here, there = self._places[one], self._places[other]
        both = all(self._arm in self.operators[n].resources for n in (one, other))
        return self.wishes.travel.get((here, there), 0) if both and here and there else 0

    @property
    def _stays(self) -> dict[int, int]:
        """How long each condition may last that says that something is in a place."""
        found: dict[int, int] = {}
        for place, most in self.wishes.longest_stay.items():
            for number, atom in enumerate(self.task.atoms):
                inside = [mentions(each, place) for each in atom.arguments]
                if any(inside) and not all(inside) and atom.name != "not":
                    found[number] = min(most, found.get(number, most))
        return found

    def _about(self, subject: Term) -> list[int]:
        return [n for n, step in enumerate(self.operators) if mentions(step.instance, subject)]

    def _by_step(self, wished: Mapping[Term, int]) -> dict[int, int]:
        found: dict[int, int] = {}
        for subject, value in wished.items():
            for n in self._about(subject):
                found[n] = max(value, found.get(n, 0))
        return found

    def _due(self) -> list[tuple[Sequence[int], int, int]]:
        wishes = self.wishes
        return [(self._about(s), due, wishes.priority.get(s, 1)) for s, due in wishes.due.items()]


def least_makespan(task: Task) -> int:
    """No plan of a task is shorter; 0 if the task is too large to be asked, leaves something out, or has derived atoms."""
    if len(task.operators) > MOST or not task.whole or task.axioms:
        return 0
    times, _ = _soonest(task.initial, task.operators)
    ways = [[times.get(atom, 0) for atom in indices(goal)] for goal in task.goals]
    return min((max(way, default=0) for way in ways), default=0)


def _soonest(initial: Bits, steps: Sequence[GroundOperator]) -> tuple[dict[int, int], list[int]]:
    """When each condition can hold and each step have ended at the soonest, if nothing that was achieved ended again."""
    times: dict[int, int] = dict.fromkeys(indices(initial), 0)
    ends: dict[int, int] = {}
    changed = True
    while changed:
        changed = False
        for n, step in enumerate(steps):
            needed = [times.get(atom) for atom in indices(step.preconditions)]
            known = [each for each in needed if each is not None]
            if len(known) < len(needed):
                continue
            end = max(known, default=0) + step.duration
            if end < ends.get(n, end + 1):
                ends[n], changed = end, True
                for atom in indices(step.adds):
                    times[atom] = min(end, times.get(atom, end))
    return times, list(ends.values())


def in_its_order(problem: Problem, plan: Plan, note: str = "", bound: int = 0) -> Timetable:
    """The plan with every step as early as its own order allows; no order of its steps ends before `bound`."""
    last = makespan(plan)
    return by_step(
        problem, plan, earliest_starts(plan), Schedule({}, (), last, bound, 0, bound == last), note
    )


def by_step(
    problem: Problem,
    plan: Plan,
    starts: Mapping[StepId, int],
    schedule: Schedule,
    note: str,
    scope: str = ORDERS,
) -> Timetable:
    """A timetable with a stage for each step; steps of one object, one after another, are a job."""
    stages = {
        step.id: Stage(f"{step.id} {step.operator}", step.duration, tuple(map(str, step.resources)))
        for step in plan.steps
    }
    jobs = tuple(
        Job(name, tuple(stages[step.id] for step in steps)) for name, steps in _jobs(problem, plan, starts)
    )
    resources = dict.fromkeys(str(resource) for step in plan.steps for resource in step.resources)
    bare = Shop(jobs, tuple(map(Resource, resources)))
    windows = tuple(bare.after(stages[a].name, stages[s.id].name) for s in plan.steps for a in s.after)
    times = {stages[step].name: start for step, start in starts.items()}
    made = replace(schedule, starts=times)
    return Timetable(plan, starts, replace(bare, windows=windows), made, scope, note)


def _jobs(problem: Problem, plan: Plan, starts: Mapping[StepId, int]) -> list[tuple[str, list[Step]]]:
    """The steps by the object of the workflow that they alone serve; other steps are jobs of their own."""
    subjects = tuple(dict.fromkeys(c.subject for c in problem.chains if c.subject is not None))
    found: dict[str, list[Step]] = {}
    for step in sorted(plan.steps, key=lambda each: (starts[each.id], each.id)):
        served = [str(subject) for subject in subjects if mentions(step.operator, subject)]
        name = served[0] if len(served) == 1 else f"{step.id} {step.operator}"
        before = found.setdefault(name, [])
        if before and starts[before[-1].id] + before[-1].duration > starts[step.id]:
            found[f"{step.id} {step.operator}"] = [step]
        else:
            before.append(step)
    return list(found.items())
