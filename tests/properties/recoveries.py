"""Whole cases in a simulated true world: an exception, its hidden cause, tests and repairs, and
the recovery carried out.
"""

import functools
import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from cellwright.engine.model.outcome import Found
from cellwright.engine.model.troubleshooting import (
    Action,
    CaseAdvice,
    CaseDiagnosis,
    CaseHypothesis,
)
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.pipelines.planning.restrictions import forbid_steps
from cellwright.engine.pipelines.recovery.case_beliefs import CaseBeliefs
from cellwright.engine.pipelines.recovery.case_findings import CaseFindings
from cellwright.engine.pipelines.recovery.case_input import exception_moment
from cellwright.engine.pipelines.recovery.diagnosis_case import (
    CaseSettings,
    DiagnosisCase,
    RecoveryResult,
    case_from_settings,
)
from cellwright.engine.pipelines.recovery.plan_revision import remaining_problem
from cellwright.engine.stages.diagnosis.case_session import QUESTION, run_session
from cellwright.engine.stages.diagnosis.fault_problems import CURED, CaseObjective
from cellwright.engine.stages.grounding import ground
from cellwright.engine.stages.validation.condition_solving import condition_holds
from cellwright.kb.asp import ground_term
from cellwright.kb.loader.fault_base import load_faults
from cellwright.kb.model.conditions import ALWAYS_TRUE, And, Literal, goal_parts
from cellwright.kb.model.fault_model import Cause, FaultModel, FaultTest, Interruption, Repair
from cellwright.kb.model.plan_model import Plan, Step
from cellwright.kb.model.planning_problem import Problem, final_stages
from cellwright.kb.terms import ANYTHING, Atom, Function
from tests.places import BUNDLED
from tests.properties.true_world import TrueWorld


@dataclass(frozen=True)
class Work:
    """A problem, a plan for it, and the fault base of its domain."""

    problem: Problem
    plan: Plan
    model: FaultModel


@dataclass
class Ended:
    """A case that has come to its end, in the belief and in truth."""

    work: Work
    desk: DiagnosisCase
    made: CaseDiagnosis
    world: TrueWorld

    @property
    def findings(self) -> CaseFindings:
        assert self.desk.beliefs is not None
        return CaseFindings(self.desk.beliefs, self.made)


@functools.cache
def work(name: str) -> Work:
    """Work in which every exception of a fault base can happen."""
    problem = checked_plan.problem_of(name)
    if name == "themse/one":  # the drawer is closed, too
        closed = ground_term("position(drawer, closed)")
        assert isinstance(closed, Function)
        problem = replace(problem, goal=And((Literal(closed),)))
    found = checked_plan.plan_problem(problem)
    assert isinstance(found, Found)
    return Work(problem, found.plan, faults(name))


@functools.cache
def faults(name: str) -> FaultModel:
    """The fault base of a bundled problem's domain."""
    return load_faults(BUNDLED / name.split("/")[0] / "domain.yaml")[0]


def interruptions(given: Work, exception: str) -> list[Step]:
    """The steps of a plan that an exception can interrupt."""
    operator = given.model.exceptions[exception].operator
    return [each for each in given.plan.steps if operator and each.operator.name == operator.name]


def case(
    given: Work, exception: str, step: Step, hidden: str, objective: CaseObjective, seed: int = 0
) -> Ended:
    """One case, tests and repairs carried out in the true world."""
    done = [each.id for each in given.plan.steps[: given.plan.steps.index(step)]]
    then = exception_moment(given.problem, step.operator, given.plan, done)
    asked = CaseSettings(
        given.model, exception, step.operator, objective, expansions=2_000, setup=False
    )
    desk = case_from_settings(asked, given.problem.domain, then)
    beliefs = desk.beliefs
    assert isinstance(beliefs, CaseBeliefs)
    world = TrueWorld(beliefs.cell, then.before, CaseHypothesis((hidden,)), random.Random(seed))

    def answer(action: Action, _: CaseAdvice) -> str:
        if action.name == QUESTION:
            return hidden if hidden in action.outcomes else action.outcomes[-1]
        prepared = desk.session.prepared
        for each in prepared.steps if prepared else ():
            world.take(each.operator)  # what cannot be taken there changes nothing
        return world.carry_out(action.name)

    return Ended(given, desk, run_session(desk.session, answer), world)


def carried_out(ended: Ended, recovery: RecoveryResult) -> str:
    """What goes wrong when the recovery is carried out in the true world; nothing if it reaches
    what it promises.
    """
    if not isinstance(recovery.outcome, Found):
        return ""
    if recovery.repair is not None:
        if wrong := ended.world.execute(step.operator for step in recovery.repair.prepared.steps):
            return wrong
        assert ended.world.carry_out(recovery.repair.name) == CURED
    wrong = ended.world.execute(step.operator for step in recovery.outcome.plan.steps)
    return wrong or "; ".join(missing(ended, recovery))


def within_reach(ended: Ended, recovery: RecoveryResult) -> Iterator[str]:
    """The goals given up that could be reached from the true state beside the causes that are
    still there.
    """
    world, problem = ended.world, ended.work.problem
    lost = {str(term) for cause in world.present for term in world.cell.lost(cause)}
    if world.helped:
        lost |= {str(term) for term in world.cell.given_up(world.cell.model.repairs[world.helped])}
    blocked = [step for cause in world.present for step in world.cell.blocked(cause)]
    left = remaining_problem(problem, world.state.reached, world.state.facts)
    given_up = {
        each.goal
        for each in recovery.given_up
        if not each.why.startswith(("it comes after", "not begun"))
    }
    wanted = [(str(part), part, ()) for part in goal_parts(left.goal)]
    for chain in left.chains:
        cuts = (
            replace(chain, stages=chain.stages[: n + 1], after=()) for n in range(len(chain.stages))
        )
        wanted += [(f"{cut.stages[-1]} of {chain.name}", ALWAYS_TRUE, (cut,)) for cut in cuts]
    for name, goal, chains in wanted:
        if name in given_up:
            alone = forbid_steps(replace(left, goal=goal, chains=chains), lost, blocked)
            if isinstance(checked_plan.plan_problem(alone), Found):
                yield name


def missing(ended: Ended, recovery: RecoveryResult) -> Iterator[str]:
    """The goals of the whole problem that are neither reached nor given up."""
    world, problem = ended.world, ended.work.problem
    given_up = [each.goal for each in recovery.given_up]
    facts = world.cell.dynamics.semantics.facts(world.state.facts)
    parts = problem.goal.parts if isinstance(problem.goal, And) else (problem.goal,)
    yield from (
        str(p) for p in parts if not condition_holds(p, facts, {}) and str(p) not in given_up
    )
    for chain in problem.chains:
        left = chain.stages[world.state.reached[chain.name] :]
        yield from (str(s) for s in left if f"{s} of {chain.name}" not in given_up)
    stages = {chain.name: chain.stages[-1] for chain in problem.chains}
    for name, last in final_stages(problem.chains, problem.domain).items():
        said = f"{stages[name]} of {name}"
        if said not in given_up and not all(each in facts for each in last):
            yield f"{said} at the end"


def random_work(seed: int) -> Work:
    """Work at the bulkhead cell with a fault base that nobody would write: causes change, lose
    and block anything.
    """
    given, draw = work("bulkhead/both_tools"), random.Random(seed)
    atoms = [a for a in ground(given.problem).atoms if a.name in given.problem.domain.predicates]
    names = [f"cause_{n}" for n in range(draw.randint(2, 5))]
    causes = {name: _cause(name, atoms, draw) for name in names}
    step = draw.choice(given.plan.steps).operator
    operator = next(each for each in given.problem.domain.operators if each.name == step.name)
    exception = Interruption(
        "trouble", "", dict.fromkeys(names, 1.0), Function(operator.name, tuple(operator.variables))
    )
    tests = {f"test_{name}": _test(f"test_{name}", name, atoms, draw) for name in names}
    repairs = {f"mend_{name}": _repair(f"mend_{name}", name, atoms, draw) for name in names}
    return Work(
        given.problem,
        given.plan,
        FaultModel("bulkhead", {"trouble": exception}, causes, tests, repairs),
    )


def _some(atoms: Sequence[Atom], most: int, draw: random.Random) -> tuple[Atom, ...]:
    return tuple(draw.sample(atoms, draw.randint(0, most)))


def _cause(name: str, atoms: Sequence[Atom], draw: random.Random) -> Cause:
    loses = tuple(
        map(Function, draw.sample(["us_probe", "slra", "t3_746"], draw.choice([0, 0, 0, 1])))
    )
    spoils = (Function("measured", (ANYTHING,) * 3),) if draw.random() < 0.3 else ()
    blocks = draw.choice([None, None, (), (Function("move", (ANYTHING,) * 3),)])
    said = _some(atoms, 1, draw), _some(atoms, 2, draw), _some(atoms, 2, draw)
    stops, completes = draw.random() < 0.2, draw.random() < 0.2
    return Cause(name, name, *said, loses, stops, completes, blocks, spoils)


def _test(name: str, cause: str, atoms: Sequence[Atom], draw: random.Random) -> FaultTest:
    needs = _some([a for a in atoms if a.name in ("at", "holding")], 1, draw)
    return FaultTest(
        name, "", draw.randint(1, 9), ("no", "yes"), "no", {cause: {"yes": 1.0}}, needs
    )


def _repair(name: str, cause: str, atoms: Sequence[Atom], draw: random.Random) -> Repair:
    cures, needs = (
        {cause: draw.choice([1.0, 0.5])},
        _some([a for a in atoms if a.name == "at"], 1, draw),
    )
    return Repair(
        name, "", draw.randint(1, 9), cures, needs, _some(atoms, 2, draw), _some(atoms, 1, draw)
    )
