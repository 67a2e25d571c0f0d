"""Planning from the problem to the checked plan: the stages in order. Each command calls one function of a pipeline.

The loaders of our own language are imported inside the functions that use them, because tasks in PDDL do not need them.
"""

import time
from dataclasses import replace

from cellwright.engine.model.outcome import Found, Outcome, Statistics
from cellwright.engine.model.task import Task
from cellwright.engine.pipelines.files import loaded as loaded
from cellwright.engine.pipelines.gate import PlanGate, refusal
from cellwright.engine.pipelines.plan_files import check_plan as check_plan
from cellwright.engine.pipelines.plan_files import plan_in as plan_in
from cellwright.engine.pipelines.renaming import in_the_order_said
from cellwright.engine.stages.grounding import ground
from cellwright.engine.stages.grounding.limits import size
from cellwright.engine.stages.grounding.need import Named, faithful, thinned, without_irrelevant
from cellwright.engine.stages.planning import NO_MACROS, Limits, Macros
from cellwright.engine.stages.planning import plan as plan_task
from cellwright.kb.asp.excerpt import excerpt
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.model.domain import Operator
from cellwright.kb.model.likeness import names
from cellwright.kb.model.plan import Plan
from cellwright.kb.model.problem import Problem
from cellwright.kb.targets import find
from cellwright.kb.terms import variables

LARGE = 200_000  # possible instances of operators


def problem_of(target: str, goals: str = "", command: str = "") -> Problem:
    """The problem that a target names. `goals`, or else a `command` in words, replaces its goals.

    A domain without operators that has a contact model beside it gets those that are generated. Raises `InvalidInput`.
    """
    from cellwright.kb.commands import understand
    from cellwright.kb.loader import problem_files, with_goals

    known = loaded(find(target))
    if goals and command:
        raise InvalidInput(
            [
                Diagnostic(
                    Source("--command"),
                    "K409",
                    "goals are given already",
                    "give --goals or --command, not both",
                )
            ]
        )
    if goals:
        return with_goals(known.domain, goals, known.problem)
    if command:
        return understand(known.problem or known.domain, command)
    if known.problem is None:
        problems = sorted(path.stem for path in problem_files(find(target)))
        ways = "give --goals or --command"
        hint = f"{ways}, or one of its problems: {', '.join(problems)}" if problems else ways
        raise InvalidInput([Diagnostic(Source(target), "K404", "this is a domain, not a problem", hint)])
    return known.problem


def plan(problem: Problem, limits: Limits = Limits()) -> Outcome:
    """A checked plan for a problem, or that there is none, or why the search gave up. Raises `InvalidInput`."""
    return planned(problem, limits)[0]


def planned(
    problem: Problem, limits: Limits = Limits(), macros: Macros = NO_MACROS, ordered: bool = False
) -> tuple[Outcome, Task]:
    """The outcome of `plan`, and the ground task. The searches may use `macros` as operators. Raises `InvalidInput`.

    If the plan shall be `ordered` and none of its steps takes time, it is made as by `in_the_order_named`.
    """
    few = excerpt(problem)
    outcome, task = searched(problem, limits, macros, few=few)
    started = time.perf_counter()
    if isinstance(outcome, Found):
        gate = PlanGate()
        made, wrong = _settled(gate, few if task.whole is False else problem, outcome.plan, ordered)
        if wrong and not task.whole:  # what was left out did play a part
            outcome, task = _searched(ground(problem), limits, macros)
            made = gate.accepted(problem, outcome.plan) if isinstance(outcome, Found) else made
        elif wrong:
            raise refusal(wrong)
        outcome = replace(outcome, plan=made) if isinstance(outcome, Found) else outcome
    seconds = {**outcome.statistics.seconds, "check": time.perf_counter() - started}
    return replace(outcome, statistics=replace(outcome.statistics, seconds=seconds)), task


def _settled(gate: PlanGate, problem: Problem, plan: Plan, ordered: bool) -> tuple[Plan, list[Diagnostic]]:
    """What the gate tells of a plan. One that is to be `ordered` is so before, so that it is checked only once."""
    if not ordered or any(step.duration for step in plan.steps):
        return gate.settled(problem, plan)
    proposed: list[Plan] = []  # ever more objects at their turn

    def noted(other: Plan) -> bool:
        proposed.append(other)
        return True

    in_the_order_said(gate.semantics(problem), plan, noted)
    if proposed and not gate.findings(problem, proposed[-1]):
        return proposed[-1], []
    made, wrong = gate.settled(problem, plan)
    return (_ordered(gate, problem, made) if len(proposed) > 1 and not wrong else made), wrong


def in_the_order_named(problem: Problem, plan: Plan) -> Plan:
    """The plan that serves alike objects in the order in which they are named, if the gate lets it pass; else the plan itself."""
    return _ordered(PlanGate(), problem, plan)


def _ordered(gate: PlanGate, problem: Problem, plan: Plan) -> Plan:
    return in_the_order_said(gate.semantics(problem), plan, lambda other: not gate.findings(problem, other))


def task_for(problem: Problem, plan: Plan) -> Task:
    """The ground task in which a plan is looked at: without most objects that it does not name and of which many are alike."""
    return ground(excerpt(problem, {name for step in plan.steps for name in names(step.operator)}))


def searched(
    problem: Problem,
    limits: Limits = Limits(),
    macros: Macros = NO_MACROS,
    statics: Named | None = None,
    proves: bool = True,
    few: Problem | None = None,
) -> tuple[Outcome, Task]:
    """An outcome that the gate has not seen, and the task that was searched; `statics` are the problem's, and `few` is
    its excerpt, if known already.

    Only what the goals can need is grounded. The whole problem is, if something that was left out might shorten a plan. A
    problem too large for that is planned without it first; unless it `proves`, nobody asks then whether that plan is the
    shortest. Raises `InvalidInput`.
    """
    started = time.perf_counter()
    small = thinned(problem, statics, few)
    if not small.left_out:
        return _searched(ground(problem), limits, macros, started)
    task = replace(without_irrelevant(ground(small.problem)), whole=False)
    if not proves and size(problem) > LARGE:
        outcome, _ = _searched(task, limits, macros, started)
        if isinstance(outcome, Found):
            return replace(outcome, optimal=False), task
    sure = faithful(task, small.spares)
    if sure or size(problem) > LARGE:
        outcome, _ = _searched(task, limits, macros, started)
        if isinstance(outcome, Found):
            alike = sure and not any(map(_is_priced, problem.domain.operators))
            return replace(outcome, optimal=outcome.optimal and alike), task
        if sure:
            return outcome, task
    return _searched(ground(problem), limits, macros, started)


def _searched(
    task: Task, limits: Limits, macros: Macros, started: float | None = None
) -> tuple[Outcome, Task]:
    grounded = time.perf_counter()
    outcome = plan_task(task, limits, macros)
    counts = {
        "operators": len(task.operators),
        "atoms": len(task.atoms),
        "mutex groups": len(task.mutex_groups),
        **outcome.statistics.counts,
    }
    before = grounded if started is None else started
    seconds = {"grounding": grounded - before, "search": time.perf_counter() - grounded}
    return replace(outcome, statistics=Statistics(counts, seconds, outcome.statistics.offer)), task


def _is_priced(operator: Operator) -> bool:
    """Whether the cost of an operator depends on its arguments."""
    return operator.cost is not None and next(variables(operator.cost), None) is not None
