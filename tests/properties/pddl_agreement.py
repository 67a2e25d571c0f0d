"""What the engine says of a PDDL task beside the definition of the language: plans, proofs,
costs, and verdicts on plans.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from random import Random

from cellwright.engine.formats.interop.pddl import PddlProblem, read_pddl_task
from cellwright.engine.formats.interop.pddl.competition_plans import read_plan, write_plan
from cellwright.engine.model.outcome import Found, Infeasible
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.stages.planning import SearchLimits
from cellwright.kb.diagnostics import InvalidInput
from tests.properties.pddl_definition import Definition, Ground

Steps = list[tuple[str, Ground]]
MAX_STATES = 1500  # of the brute force
MAX_EXPANSIONS = 20_000


@dataclass
class Agreement:
    """What became of a task (found, infeasible, gave up, refused), which plans were judged, and
    where both differ.
    """

    outcome: str = ""
    certain: bool = False  # whether the brute force has an answer
    steps: int = 0
    judged: int = 0
    differences: list[str] = field(default_factory=list)


def compared(domain: str, problem: str, folder: Path, seed: int) -> Agreement:
    """The engine and the definition on one task; `seed` chooses the plans that both judge."""
    files = folder / "domain.pddl", folder / "problem.pddl"
    for file, text in zip(files, (domain, problem), strict=True):
        file.write_text(text)
    found = Agreement()
    try:
        task = read_pddl_task(*files)
        outcome = checked_plan.plan_problem(task.problem, SearchLimits(MAX_EXPANSIONS))
    except InvalidInput as refused:
        found.outcome = f"refused ({refused.diagnostics[0].message})"
        return found
    definition = Definition(domain, problem)
    shortest, found.certain = definition.search(MAX_STATES)
    found.outcome = type(outcome).__name__
    if isinstance(outcome, Found):
        steps = _steps(write_plan(task, outcome.plan))
        found.steps = len(steps)
        cost = Fraction(outcome.plan.cost, task.unit_of_cost)
        found.differences += _of_plan(definition, steps, cost)
        if found.certain and shortest is None:
            found.differences.append(f"a plan where there is none: {steps}")
    elif isinstance(outcome, Infeasible) and shortest is not None:
        found.differences.append(f"a false proof: {shortest}")
    plans = [*([] if shortest is None else [shortest]), *_random_plans(definition, Random(seed))]
    found.judged = len(plans)
    found.differences += _of_verdicts(definition, task, plans, folder / "plan")
    return found


def _steps(text: str) -> Steps:
    lines = (line.strip("()").split() for line in text.splitlines() if line.startswith("("))
    return [(name, tuple(arguments)) for name, *arguments in lines]


def _of_plan(definition: Definition, steps: Steps, cost: Fraction) -> Iterator[str]:
    if not definition.accepts(steps):
        yield f"a wrong plan: {steps}"
    elif definition.cost(steps) != cost:
        yield f"a cost of {cost} instead of {definition.cost(steps)}: {steps}"


def _of_verdicts(
    definition: Definition, task: PddlProblem, plans: list[Steps], file: Path
) -> Iterator[str]:
    for steps in plans:
        file.write_text("".join(f"({' '.join((name, *arguments))})\n" for name, arguments in steps))
        valid = not checked_plan.check_plan(task.problem, read_plan(task, file))
        if valid != definition.accepts(steps):
            yield f"a verdict '{'valid' if valid else 'invalid'}': {steps}"


def _random_plans(definition: Definition, random: Random) -> Iterator[Steps]:
    """A few random sequences of actions, most of which are applicable."""
    everything = list(definition.steps())
    for _ in range(6):
        state, steps = definition.start(), Steps()
        for _ in range(random.randint(0, 4)):
            following = {
                each: after for each in everything if (after := definition.after(state, *each))
            }
            choices = list(following) if random.random() < 0.8 else everything
            if not choices:
                break
            steps.append(random.choice(choices))
            if steps[-1] not in following:
                break
            state = following[steps[-1]]
        yield steps
