"""Repair or replan, whichever is cheaper.

If the kernel of a tail holds in the observed state, the plan goes on with the shortest such tail. Otherwise the planner
plans from the observed state to the kernel of some tail; the task is grounded already. Steps that the new situation makes
needless are dropped (Nakhost & Müller 2010). The problem is replanned as a whole if repair fails or costs too much. If the
task is small, replanning is compared with every repair over a gap: what leads back to the old plan may be a detour.
"""

import dataclasses
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

from cellwright.engine.model.outcome import Found, GaveUp, Outcome
from cellwright.engine.model.replay import early
from cellwright.engine.model.stages import STAGE
from cellwright.engine.model.task import Bits, GroundOperator
from cellwright.engine.pipelines import planning
from cellwright.engine.pipelines.attainment import GivenUp, Obstacles, attainable
from cellwright.engine.pipelines.revision.course import Course
from cellwright.engine.pipelines.revision.remaining import remaining, stages_reached
from cellwright.engine.stages.macros.lifted.execution import changes_of
from cellwright.engine.stages.planning import Limits
from cellwright.engine.stages.planning import plan as plan_task
from cellwright.engine.stages.planning.elimination import eliminate
from cellwright.engine.stages.planning.improvement.deorder import deorder
from cellwright.engine.stages.planning.variants import plainly
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.model.plan import CausalLink, Plan, Step, StepId
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import Atom, Function, Number, Text

Sequencer = Callable[[Problem, Limits], Outcome | None]
"""The answer for a problem whose acts the domain puts in order, as an inspection's measurements; None for any other."""

GAPS = 3  # the most tails to which a gap is planned
SMALL = 500  # operators of a task that is planned anew in any case, to see whether that is cheaper than to lead back to the plan
SLACK = 5  # a repair may cost so much more than the steps left, or a quarter more if that is more


@dataclass(frozen=True, slots=True)
class PlanRevision:
    """How the plan goes on. `way`: done, continued, repaired or replanned.

    `problem` is what was left to do, `outcome` the answer for it. `kept`, `dropped` and `added` compare steps with those
    that were left of the old plan. Costs are None where a way was not tried or led nowhere. `given_up` are the goals that
    cannot be reached any more; the answer is for the others.
    """

    problem: Problem
    outcome: Outcome
    way: str
    kept: tuple[Step, ...] = ()
    dropped: tuple[Step, ...] = ()
    added: tuple[Step, ...] = ()
    repair_cost: int | None = None
    replanning_cost: int | None = None
    given_up: tuple[GivenUp, ...] = ()


def no_sequence(_problem: Problem, _limits: Limits) -> Outcome | None:
    """Nothing is put in order."""
    return None


def revise(
    course: Course,
    done: Sequence[StepId],
    observed: Sequence[Atom],
    limits: Limits = Limits(),
    both: bool = False,
    obstacles: Obstacles | None = None,
    sequencer: Sequencer = no_sequence,
) -> PlanRevision:
    """A plan for what is left, after the steps `done`, from the state `observed`; else for the goals that can be reached.

    `both` compares repair with replanning in any case. `obstacles` are possible reasons for goals that are given up. Where
    the steps left do not reach all goals that are open, the `sequencer` says anew in which order: steps put in front of them
    could cost little, and go to and fro. Raises `InvalidInput`.
    """
    finished = [step for step in course.plan.steps if step.id in set(done)]
    left = [step for step in course.plan.steps if step.id not in set(done)]
    reached = stages_reached(course.problem.chains, course.start, changes_of(course.start, finished))
    problem = remaining(course.problem, reached, observed)
    repair = _PlanRepair(course, problem, reached, left, limits)
    kept, way = repair.continued()
    in_order = sequencer(problem, limits) if kept is None and repair.leaves_goals() else None
    if isinstance(in_order, Found) and not both:
        return _revision(problem, in_order, "replanned", left, None, in_order.plan.cost)
    repaired = repair.over_a_gap() if kept is None else kept
    compared = both or (kept is None and len(course.task.operators) <= SMALL)
    if repaired is not None and repaired.cost <= affordable(left) and not compared:
        return _revision(problem, Found(repaired), way, left, repaired.cost, None)
    if repaired is None:
        return planned_anew(problem, Plan(tuple(left)), limits, obstacles, sequencer)
    replanned = in_order or _anew(problem, limits, sequencer)
    cost = replanned.plan.cost if isinstance(replanned, Found) else None
    if cost is None or repaired.cost <= cost:
        return _revision(problem, Found(repaired), way, left, repaired.cost, cost)
    return _revision(problem, replanned, "replanned", left, repaired.cost, cost)


def _anew(problem: Problem, limits: Limits, sequencer: Sequencer) -> Outcome:
    """The answer for all goals; that nothing is known if the state lacks what planning needs and a repair does not."""
    try:
        return sequencer(problem, limits) or planning.plan(problem, limits)
    except InvalidInput as error:
        return GaveUp(str(error))


def planned_anew(
    problem: Problem,
    left: Plan | None = None,
    limits: Limits = Limits(),
    obstacles: Obstacles | None = None,
    sequencer: Sequencer = no_sequence,
) -> PlanRevision:
    """A new plan for the goals of a problem that can be reached, compared with the steps that were left of an old one."""
    found = attainable(
        problem, obstacles, limits, planner=lambda *asked: sequencer(*asked) or planning.plan(*asked)
    )
    cost = found.outcome.plan.cost if isinstance(found.outcome, Found) else None
    steps = left.steps if left else ()
    made = _revision(found.problem, found.outcome, "replanned", steps, None, cost)
    return dataclasses.replace(made, given_up=found.given_up)


def affordable(left: Sequence[Step]) -> int:
    """The most that a repair may cost before replanning is tried, too."""
    wanted = sum(step.cost for step in left)
    return wanted + max(SLACK, wanted // 4)


def _revision(
    problem: Problem,
    outcome: Outcome,
    way: str,
    left: Sequence[Step],
    repair: int | None,
    replanning: int | None,
) -> PlanRevision:
    steps = outcome.plan.steps if isinstance(outcome, Found) else ()
    kept, added = _common(steps, left)
    _, dropped = _common(left, steps)
    return PlanRevision(problem, outcome, way, kept, dropped, added, repair, replanning)


def _common(steps: Sequence[Step], others: Sequence[Step]) -> tuple[tuple[Step, ...], tuple[Step, ...]]:
    """The steps that occur among the others, each matched once, and the steps that do not."""
    free = Counter(step.operator for step in others)
    shared, own = [], []
    for step in steps:
        if free[step.operator] > 0:
            free[step.operator] -= 1
            shared.append(step)
        else:
            own.append(step)
    return tuple(shared), tuple(own)


@dataclass(frozen=True)
class _PlanRepair:
    course: Course
    problem: Problem
    reached: dict[str, int]
    left: Sequence[Step]
    limits: Limits

    def continued(self) -> tuple[Plan | None, str]:
        """The plan that goes on as it was, or has nothing more to do, and which of both; None if that is no plan."""
        if self.course.reached_goals(self._here) is not None and self._passed(Plan(())) is not None:
            return Plan(()), "done"
        if self._tail is None:
            return None, "repaired"
        goals, steps = self._tail
        whole = next((n for n in range(len(steps), -1, -1) if not self._kernels[n] & ~self._here), None)
        made = None if whole is None else self._made(steps[whole:], goals)
        return made, "repaired" if whole is None else "continued"

    def leaves_goals(self) -> bool:
        """Whether there are open goals that the steps left do not reach."""
        return self._tail is None or bool(self._tail[0] & self._kernels[0] & ~self._here)

    @cached_property
    def _here(self) -> Bits:
        return self.course.bits(self.problem.initial, self.reached)

    @cached_property
    def _kernels(self) -> Sequence[Bits]:
        """What must hold before each tail of the steps that were left, so that it reaches the goals."""
        if self._tail is None:
            return ()
        goals, steps = self._tail
        return self.course.kernels(steps, goals)

    @cached_property
    def _tail(self) -> tuple[Bits, list[GroundOperator]] | None:
        """The goals that the plan was to reach, and the steps that were left, as ground operators; None if they fail."""
        finished = [step for step in self.course.plan.steps if step not in self.left]
        state, operators = self.course.task.initial, list[GroundOperator]()
        for steps in (finished, self.left):
            task = dataclasses.replace(self.course.task, initial=state)
            executed = self.course.executed(state, [step.operator for step in steps])
            if executed is None:
                return None
            operators = plainly(task, executed)  # kernels do not see conditional effects
            for operator in operators:
                state = task.after(state, operator)
        goals = self.course.reached_goals(state)
        return None if goals is None else (goals, operators)

    def over_a_gap(self) -> Plan | None:
        """A plan that leads to the kernel of a tail, followed by that tail.

        Tails come first whose kernels miss few atoms and which cost little. The first affordable plan is taken, else the
        cheapest of a few. None as well if a tail holds as it is, so that there is no gap.
        """
        if self._tail is None or any(not each & ~self._here for each in self._kernels):
            return None
        goals, steps = self._tail

        def promise(n: int) -> tuple[int, int]:
            missing = (self._kernels[n] & ~self._here).bit_count()
            return missing + sum(step.cost for step in steps[n:]), n

        best: Plan | None = None
        for n in sorted(range(len(steps) + 1), key=promise)[:GAPS]:
            made = self._gap(steps[n:], goals, self._kernels[n])
            if made is not None and (best is None or made.cost < best.cost):
                best = made
            if best is not None and best.cost <= affordable(self.left):
                break
        return best

    def _gap(self, tail: Sequence[GroundOperator], goals: Bits, kernel: Bits) -> Plan | None:
        task = dataclasses.replace(self.course.task, initial=self._here, goals=(kernel,))
        outcome = plan_task(task, self.limits)
        if not isinstance(outcome, Found):
            return None
        gap = self.course.executed(self._here, [step.operator for step in outcome.plan.steps])
        return self._made([*gap, *tail], goals) if gap is not None else None

    def _made(self, steps: Sequence[GroundOperator], goals: Bits) -> Plan | None:
        """A plan of those steps that are needed; None if it does not pass the gate."""
        task = dataclasses.replace(self.course.task, initial=self._here)
        kept = eliminate(self._here, early(task, plainly(task, steps)), goals)
        made = deorder(task, kept, goals)
        shifted = Plan(made.steps, tuple(self._shifted(link) for link in made.links))
        return self._passed(shifted)

    def _passed(self, plan: Plan) -> Plan | None:
        """The plan as it may be given out; None if the checker refuses it, so that another plan must be found."""
        settled, wrong = self.course.gate.settled(self.problem, plan)
        return None if wrong else settled

    def _shifted(self, link: CausalLink) -> CausalLink:
        """A causal link; if its condition is a stage, the stages reached already are not counted."""
        condition = link.condition
        if condition.name != STAGE:
            return link
        chain, number = condition.arguments
        assert isinstance(chain, Text)
        assert isinstance(number, Number)
        counted = Function(STAGE, (chain, Number(number.value - self.reached[chain.value])))
        return dataclasses.replace(link, condition=counted)
