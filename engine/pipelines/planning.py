"""Planning from the problem to the checked plan: the stages in order. Each command calls one function of a pipeline.

The loaders of our own language are imported inside the functions that use them, because tasks in PDDL do not need them.
"""

import time
from dataclasses import replace

from engine.model.outcome import Found, Outcome, Statistics
from engine.model.task import Task
from engine.pipelines.gate import PlanGate, accepted
from engine.stages.grounding import ground
from engine.stages.grounding.limits import require_affordable_statics
from engine.stages.planning import NO_MACROS, Limits, Macros
from engine.stages.planning import plan as plan_task
from engine.stages.validation import validate
from engine.stages.validation.claims import makespan, times
from kb.diagnostics import Diagnostic, InvalidInput, Source
from kb.model.plan import Claims, Plan
from kb.model.problem import Problem
from kb.terms import Atom


def problem_of(target: str, goals: str = "", command: str = "") -> Problem:
    """The problem that a target names. `goals`, or else a `command` in words, replaces its goals.

    A domain without operators that has a contact model beside it gets those that are generated. Raises `InvalidInput`.
    """
    from engine.pipelines.task_space import generated_if_bare
    from kb.commands import understand
    from kb.loader import find, load, problem_files, with_goals

    loaded = load(find(target), generated_if_bare)
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
        return with_goals(loaded.domain, goals, loaded.problem)
    if command:
        return understand(loaded.problem or loaded.domain, command)
    if loaded.problem is None:
        problems = sorted(path.stem for path in problem_files(find(target)))
        ways = "give --goals or --command"
        hint = f"{ways}, or one of its problems: {', '.join(problems)}" if problems else ways
        raise InvalidInput([Diagnostic(Source(target), "K404", "this is a domain, not a problem", hint)])
    return loaded.problem


def plan(problem: Problem, limits: Limits = Limits()) -> Outcome:
    """A checked plan for a problem, or that there is none, or why the search gave up. Raises `InvalidInput`."""
    return planned(problem, limits)[0]


def planned(problem: Problem, limits: Limits = Limits(), macros: Macros = NO_MACROS) -> tuple[Outcome, Task]:
    """The outcome of `plan`, and the ground task. The searches may use `macros` as operators. Raises `InvalidInput`."""
    started = time.perf_counter()
    task = ground(problem)
    grounded = time.perf_counter()
    outcome = plan_task(task, limits, macros)
    finished = time.perf_counter()
    if isinstance(outcome, Found):
        outcome = replace(outcome, plan=accepted(problem, outcome.plan))
    checked = time.perf_counter()
    counts = {
        "operators": len(task.operators),
        "atoms": len(task.atoms),
        "mutex groups": len(task.mutex_groups),
        **outcome.statistics.counts,
    }
    seconds = {"grounding": grounded - started, "search": finished - grounded, "check": checked - finished}
    statistics = Statistics(counts, seconds, outcome.statistics.offer)
    return replace(outcome, statistics=statistics), task


def check_plan(
    problem: Problem, made: Plan, name: str = "plan", claims: Claims | None = None
) -> list[Diagnostic]:
    """Everything that the independent checker has against a plan and against what is claimed of it; empty if it is valid.

    Raises `InvalidInput`.
    """
    require_affordable_statics(problem)
    return validate(problem, made, name, claims)


def ending(made: Plan, claims: Claims | None = None) -> int:
    """When the last step ends; each starts when it is said to, else as soon as it can."""
    return makespan(made, times(made, claims or Claims()))


def initial_facts(target: str) -> frozenset[Atom]:
    """The initial state of the problem that a target names; empty for a domain. Raises `InvalidInput`."""
    from kb.loader import find, load

    problem = load(find(target)).problem
    return frozenset() if problem is None else PlanGate().semantics(problem).initial()
