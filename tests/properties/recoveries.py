"""Whole cases in a simulated true world: an exception, its hidden cause, tests and repairs, and the recovery carried out."""

import functools
import random
from collections.abc import Iterator
from dataclasses import dataclass, replace

from engine.model.cases import Diagnosis, Hypothesis
from engine.model.outcome import Found
from engine.model.troubleshooting import Action, Advice
from engine.pipelines import planning
from engine.pipelines.simulation import TrueWorld
from engine.pipelines.troubleshooting import Desk, Opened, Recovery, opened
from engine.pipelines.troubleshooting.beliefs import Beliefs
from engine.pipelines.troubleshooting.findings import Findings
from engine.pipelines.troubleshooting.given import moment
from engine.stages.diagnosis.knowledge import CURED, Objective
from engine.stages.diagnosis.session import QUESTION, run
from engine.stages.validation.datalog import holds
from kb.asp import ground_term
from kb.loader.faults import load_faults
from kb.model.conditions import And, Literal
from kb.model.faults import FaultModel
from kb.model.plan import Plan, Step
from kb.model.problem import Problem
from kb.model.workflow import lasting
from kb.terms import Function
from tests.places import BUNDLED


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
    desk: Desk
    made: Diagnosis
    world: TrueWorld

    @property
    def findings(self) -> Findings:
        assert self.desk.beliefs is not None
        return Findings(self.desk.beliefs, self.made)


@functools.cache
def work(name: str) -> Work:
    """Work in which every exception of a fault base can happen."""
    problem = planning.problem_of(name)
    if name == "themse/one":  # the drawer is closed, too
        closed = ground_term("position(drawer, closed)")
        assert isinstance(closed, Function)
        problem = replace(problem, goal=And((Literal(closed),)))
    found = planning.plan(problem)
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


def case(given: Work, exception: str, step: Step, hidden: str, objective: Objective, seed: int = 0) -> Ended:
    """One case, tests and repairs carried out in the true world."""
    done = [each.id for each in given.plan.steps[: given.plan.steps.index(step)]]
    then = moment(given.problem, step.operator, given.plan, done)
    asked = Opened(given.model, exception, step.operator, objective, expansions=2_000, setup=False)
    desk = opened(asked, given.problem.domain, then)
    beliefs = desk.beliefs
    assert isinstance(beliefs, Beliefs)
    world = TrueWorld(beliefs.cell, then.before, Hypothesis((hidden,)), random.Random(seed))

    def answer(action: Action, _: Advice) -> str:
        if action.name == QUESTION:
            return hidden if hidden in action.outcomes else action.outcomes[-1]
        prepared = desk.session.prepared
        for each in prepared.steps if prepared else ():
            world.take(each.operator)  # what cannot be taken there changes nothing
        return world.carry_out(action.name)

    return Ended(given, desk, run(desk.session, answer), world)


def carried_out(ended: Ended, recovery: Recovery) -> str:
    """What goes wrong when the recovery is carried out in the true world; nothing if it reaches what it promises."""
    if not isinstance(recovery.outcome, Found):
        return ""
    if recovery.repair is not None:
        if wrong := ended.world.execute(step.operator for step in recovery.repair.prepared.steps):
            return wrong
        assert ended.world.carry_out(recovery.repair.name) == CURED
    wrong = ended.world.execute(step.operator for step in recovery.outcome.plan.steps)
    return wrong or "; ".join(missing(ended, recovery))


def missing(ended: Ended, recovery: Recovery) -> Iterator[str]:
    """The goals of the whole problem that are neither reached nor given up."""
    world, problem = ended.world, ended.work.problem
    given_up = [each.goal for each in recovery.given_up]
    facts = world.cell.dynamics.semantics.facts(world.state.facts)
    parts = problem.goal.parts if isinstance(problem.goal, And) else (problem.goal,)
    yield from (str(p) for p in parts if not holds(p, facts, {}) and str(p) not in given_up)
    for chain in problem.chains:
        left = chain.stages[world.state.reached[chain.name] :]
        yield from (str(s) for s in left if f"{s} of {chain.name}" not in given_up)
    for name, last in lasting(problem.chains, problem.domain).items():
        if last not in facts and f"{last} of {name}" not in given_up:
            yield f"{last} at the end"
