"""Plan revision: repair the steps that are left or replan, whichever is cheaper."""

import dataclasses
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from cellwright.engine.kernels.bits import Bits, indices
from cellwright.engine.model.ground_axioms import Comparing, QuantityLevel
from cellwright.engine.model.ground_task import GroundOperator, GroundTask
from cellwright.engine.model.outcome import Found, GaveUp, Outcome
from cellwright.engine.model.workflow_replay import (
    STAGE_FLUENT,
    Instances,
    operators_by_instance,
    reach_stages_early,
    reached_at_the_end,
    replay_instances,
    settle_stages,
    stage_atom,
)
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.pipelines.planning.checked_plan import task_for
from cellwright.engine.pipelines.planning.goal_selection import (
    Obstacles,
    RelinquishedGoal,
    select_goals,
)
from cellwright.engine.pipelines.planning.plan_gate import PlanGate
from cellwright.engine.pipelines.recovery.remaining_problem import remaining_problem, stages_reached
from cellwright.engine.stages.lifted.cell_domain import CellDomain, Situation
from cellwright.engine.stages.lifted.lifted_execution import changes_of
from cellwright.engine.stages.planning import SearchLimits, plan_task
from cellwright.engine.stages.planning.action_elimination import eliminate_actions
from cellwright.engine.stages.planning.effect_variants import plain_steps
from cellwright.engine.stages.planning.improvement.plan_reordering import deorder_steps
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.model.plan_model import CausalLink, Plan, Step, StepId
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Atom, Function, Number, Text


@dataclass(frozen=True)
class PlanUnderWay:
    """A problem, the plan that is being executed, the ground task, the start situation, and the
    gate for repairs.
    """

    problem: Problem
    plan: Plan
    task: GroundTask
    start: Situation
    gate: PlanGate

    @classmethod
    def of(cls, problem: Problem, plan: Plan) -> "PlanUnderWay":
        """Ground the problem once, so that revisions need not ground it again.

        Raises `InvalidInput`.
        """
        gate = PlanGate()
        start = Situation.of(CellDomain(problem), gate.semantics(problem).initial())
        return cls(problem, plan, task_for(problem, plan), start, gate)

    @cached_property
    def index(self) -> Mapping[Atom, int]:
        """The number of each atom."""
        return {atom: number for number, atom in enumerate(self.task.atoms)}

    @cached_property
    def instances(self) -> Instances:
        """The ground operators of each instance."""
        return operators_by_instance(self.task)

    def bits(self, observed: Iterable[Atom], reached: Mapping[str, int]) -> Bits:
        """A state of the task: what is observed, the stages reached and those that hold now,
        complements; atoms it does not know are left out."""
        mask = 0
        for atom in observed:
            mask |= 1 << self.index[atom] if atom in self.index else self._value(atom)
        for level in self._levels.values():
            mask |= 0 if mask & level.mask else self.task.initial & level.mask
        for chain in self.problem.chains:
            mask |= 1 << self.index[stage_atom(chain, reached[chain.name])]
        for number, atom in enumerate(self.task.atoms):
            if atom.name == "not" and len(atom.arguments) == 1:
                inner = atom.arguments[0]
                assert isinstance(inner, Function)
                if not mask >> self.index[inner] & 1:
                    mask |= 1 << number
            elif (
                atom.name.startswith("_")
                and atom.name != STAGE_FLUENT
                and self.task.initial >> number & 1
            ):
                mask |= 1 << number
        return settle_stages(self.task, mask)

    @cached_property
    def _levels(self) -> Mapping[Atom, QuantityLevel]:
        """The quantities of the task by their names."""
        changes = [change for operator in self.task.operators for change in operator.changes]
        sums = [change.to for change in changes] + [comparison.sum for comparison in self._compared]
        levels = [change.level for change in changes] + [
            level for parts in sums for level, _ in parts.parts
        ]
        return {level.quantity: level for level in levels}

    @property
    def _compared(self) -> Sequence[Comparing]:
        return self.task.axioms.tests if self.task.axioms is not None else ()

    def _value(self, atom: Atom) -> Bits:
        """The atom for a value of a quantity, which no search has met yet; nothing for other
        atoms.
        """
        level = self._levels.get(Function(atom.name, atom.arguments[:-1]))
        if level is None or not isinstance(last := atom.arguments[-1], Number):
            return 0
        return level.bit(last.value)

    def executed(self, state: Bits, steps: Iterable[Function]) -> list[GroundOperator] | None:
        """The ground operators of instances taken one after another from a state, with the internal
        ones that reach stages between them; None if an instance cannot be taken."""
        return replay_instances(self.task, self.instances, state, steps)

    def kernels(self, steps: Sequence[GroundOperator], goals: Bits) -> list[Bits]:
        """For each position, the atoms that the steps from there on need to reach the goals;
        the last are the goals.
        """
        conditions = [goals]
        for operator in reversed(steps):
            conditions.append((conditions[-1] & ~operator.adds) | operator.preconditions)
        return conditions[::-1]

    def reached_goals(self, state: Bits) -> Bits | None:
        """The alternative of the goals that holds in a state; None if none holds."""
        return reached_at_the_end(self.task, state)

    def named(self, bits: Bits) -> tuple[Atom, ...]:
        """The atoms in a bitset."""
        return tuple(self.task.atoms[number] for number in indices(bits))


Sequencer = Callable[[Problem, SearchLimits], Outcome | None]
"""The answer for a problem whose acts the domain puts in order, as an inspection's
measurements; None for any other.
"""

MAX_GAP_TAILS = 3  # the most tails to which a gap is planned
# operators of a task that is planned anew in any case, to see whether that is cheaper than to lead
# back to the plan
MAX_REPLANNED_OPERATORS = 500
# a repair may cost so much more than the steps left, or a quarter more if that is more
REPAIR_SLACK = 5


@dataclass(frozen=True, slots=True)
class PlanRevision:
    """How the plan goes on. `way`: done, continued, repaired or replanned.

    `problem` is what was left to do, `outcome` the answer for it. `kept`, `dropped` and `added`
    compare steps with those that were left of the old plan. Costs are None where a way was not
    tried or led nowhere. `given_up` are the goals that cannot be reached any more; the answer is
    for the others.
    """

    problem: Problem
    outcome: Outcome
    way: str
    kept: tuple[Step, ...] = ()
    dropped: tuple[Step, ...] = ()
    added: tuple[Step, ...] = ()
    repair_cost: int | None = None
    replanning_cost: int | None = None
    given_up: tuple[RelinquishedGoal, ...] = ()


def no_sequence(_problem: Problem, _limits: SearchLimits) -> Outcome | None:
    """Nothing is put in order."""
    return None


def revise_plan(
    course: PlanUnderWay,
    done: Sequence[StepId],
    observed: Sequence[Atom],
    limits: SearchLimits = SearchLimits(),
    both: bool = False,
    obstacles: Obstacles | None = None,
    sequencer: Sequencer = no_sequence,
) -> PlanRevision:
    """A plan for what is left, after the steps `done`, from the state `observed`; else for the
    goals that can be reached.

    `both` compares repair with replanning in any case. `obstacles` are possible reasons for goals
    that are given up. Where the steps left do not reach all goals that are open, the `sequencer`
    says anew in which order: steps put in front of them could cost little, and go to and fro.
    Raises `InvalidInput`.
    """
    finished = [step for step in course.plan.steps if step.id in set(done)]
    rest_steps = [step for step in course.plan.steps if step.id not in set(done)]
    reached = stages_reached(
        course.problem.chains, course.start, changes_of(course.start, finished)
    )
    problem = remaining_problem(course.problem, reached, observed)
    repair = _PlanRepair(course, problem, reached, rest_steps, limits)
    revised, way_on = repair.continued()
    in_order = sequencer(problem, limits) if revised is None and repair.leaves_goals() else None
    if isinstance(in_order, Found) and not both:
        return _revision_of(problem, in_order, "replanned", rest_steps, None, in_order.plan.cost)
    repaired = repair.over_a_gap() if revised is None else revised
    compared = both or (revised is None and len(course.task.operators) <= MAX_REPLANNED_OPERATORS)
    if repaired is not None and repaired.cost <= affordable_repair(rest_steps) and not compared:
        return _revision_of(problem, Found(repaired), way_on, rest_steps, repaired.cost, None)
    if repaired is None:
        return planned_anew(problem, Plan(tuple(rest_steps)), limits, obstacles, sequencer)
    replanned = in_order or _plan_anew(problem, limits, sequencer)
    cost = replanned.plan.cost if isinstance(replanned, Found) else None
    if cost is None or repaired.cost <= cost:
        return _revision_of(problem, Found(repaired), way_on, rest_steps, repaired.cost, cost)
    return _revision_of(problem, replanned, "replanned", rest_steps, repaired.cost, cost)


def _plan_anew(problem: Problem, limits: SearchLimits, sequencer: Sequencer) -> Outcome:
    """The answer for all goals; that nothing is known if the state lacks what planning needs
    and a repair does not.
    """
    try:
        return sequencer(problem, limits) or checked_plan.plan_problem(problem, limits)
    except InvalidInput as error:
        return GaveUp(str(error))


def planned_anew(
    problem: Problem,
    left: Plan | None = None,
    limits: SearchLimits = SearchLimits(),
    obstacles: Obstacles | None = None,
    sequencer: Sequencer = no_sequence,
) -> PlanRevision:
    """A new plan for the goals of a problem that can be reached, compared with the steps that
    were left of an old one.
    """
    attained = select_goals(
        problem,
        obstacles,
        limits,
        planner=lambda *asked: sequencer(*asked) or checked_plan.plan_problem(*asked),
    )
    cost = attained.outcome.plan.cost if isinstance(attained.outcome, Found) else None
    steps = left.steps if left else ()
    revision = _revision_of(attained.problem, attained.outcome, "replanned", steps, None, cost)
    return dataclasses.replace(revision, given_up=attained.given_up)


def affordable_repair(left: Sequence[Step]) -> int:
    """The most that a repair may cost before replanning is tried, too."""
    cost_left = sum(step.cost for step in left)
    return cost_left + max(REPAIR_SLACK, cost_left // 4)


def _revision_of(
    problem: Problem,
    outcome: Outcome,
    way: str,
    left: Sequence[Step],
    repair: int | None,
    replanning: int | None,
) -> PlanRevision:
    steps = outcome.plan.steps if isinstance(outcome, Found) else ()
    kept_steps, added = _common_steps(steps, left)
    _, dropped = _common_steps(left, steps)
    return PlanRevision(problem, outcome, way, kept_steps, dropped, added, repair, replanning)


def _common_steps(
    steps: Sequence[Step], others: Sequence[Step]
) -> tuple[tuple[Step, ...], tuple[Step, ...]]:
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
    course: PlanUnderWay
    problem: Problem
    reached: dict[str, int]
    left: Sequence[Step]
    limits: SearchLimits

    def continued(self) -> tuple[Plan | None, str]:
        """The plan that goes on as it was, or has nothing more to do, and which of both; None
        if that is no plan.
        """
        if self.course.reached_goals(self._here) is not None and self._passed(Plan(())) is not None:
            return Plan(()), "done"
        if self._tail is None:
            return None, "repaired"
        goals, steps = self._tail
        whole = next(
            (n for n in range(len(steps), -1, -1) if not self._kernels[n] & ~self._here), None
        )
        whole_tail = None if whole is None else self._made(steps[whole:], goals)
        return whole_tail, "repaired" if whole is None else "continued"

    def leaves_goals(self) -> bool:
        """Whether there are open goals that the steps left do not reach."""
        return self._tail is None or bool(self._tail[0] & self._kernels[0] & ~self._here)

    @cached_property
    def _here(self) -> Bits:
        return self.course.bits(self.problem.initial, self.reached)

    @cached_property
    def _kernels(self) -> Sequence[Bits]:
        """What must hold before each tail of the steps that were left, so that it reaches the
        goals.
        """
        if self._tail is None:
            return ()
        goals, steps = self._tail
        return self.course.kernels(steps, goals)

    @cached_property
    def _tail(self) -> tuple[Bits, list[GroundOperator]] | None:
        """The goals that the plan was to reach, and the steps that were left, as ground
        operators; None if they fail.
        """
        finished = [step for step in self.course.plan.steps if step not in self.left]
        state, operators = self.course.task.initial, list[GroundOperator]()
        for steps in (finished, self.left):
            task = dataclasses.replace(self.course.task, initial=state)
            executed = self.course.executed(state, [step.operator for step in steps])
            if executed is None:
                return None
            operators = plain_steps(task, executed)  # kernels do not see conditional effects
            for operator in operators:
                state = task.after(state, operator)
        goals = self.course.reached_goals(state)
        return None if goals is None else (goals, operators)

    def over_a_gap(self) -> Plan | None:
        """A plan that leads to the kernel of a tail, followed by that tail.

        Tails come first whose kernels miss few atoms and which cost little. The first affordable
        plan is taken, else the cheapest of a few. None as well if a tail holds as it is, so that
        there is no gap.
        """
        if self._tail is None or any(not kernel & ~self._here for kernel in self._kernels):
            return None
        goals, steps = self._tail

        def promise(n: int) -> tuple[int, int]:
            missing = (self._kernels[n] & ~self._here).bit_count()
            return missing + sum(step.cost for step in steps[n:]), n

        best: Plan | None = None
        for n in sorted(range(len(steps) + 1), key=promise)[:MAX_GAP_TAILS]:
            gap_plan = self._gap(steps[n:], goals, self._kernels[n])
            if gap_plan is not None and (best is None or gap_plan.cost < best.cost):
                best = gap_plan
            if best is not None and best.cost <= affordable_repair(self.left):
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
        needed = eliminate_actions(
            self._here, reach_stages_early(task, plain_steps(task, steps)), goals
        )
        deordered = deorder_steps(task, needed, goals)
        shifted = Plan(deordered.steps, tuple(self._shifted(link) for link in deordered.links))
        return self._passed(shifted)

    def _passed(self, plan: Plan) -> Plan | None:
        """The plan as it may be given out; None if the checker refuses it, so that another plan
        must be found.
        """
        settled, wrong = self.course.gate.settled(self.problem, plan)
        return None if wrong else settled

    def _shifted(self, link: CausalLink) -> CausalLink:
        """A causal link; if its condition is a stage, the stages reached already are not
        counted.
        """
        condition = link.condition
        if condition.name != STAGE_FLUENT:
            return link
        chain, number = condition.arguments
        assert isinstance(chain, Text)
        assert isinstance(number, Number)
        counted = Function(STAGE_FLUENT, (chain, Number(number.value - self.reached[chain.value])))
        return dataclasses.replace(link, condition=counted)


__all__ = ["PlanRevision", "PlanUnderWay", "planned_anew", "remaining_problem", "revise_plan"]
