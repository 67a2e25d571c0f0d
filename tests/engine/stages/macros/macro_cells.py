"""Plans and worlds for the tests of macros: golden plans of the bundled cells, and the paper's own operators."""

import functools
from dataclasses import dataclass
from pathlib import Path

from engine.stages.macros.learning.generalise import Generalised, generalise
from engine.stages.macros.lifted.world import CellDomain, State
from engine.stages.validation.semantics import Semantics
from kb.loader import load
from kb.loader.plan import load_plan
from kb.model.plan import Plan, Step, StepId
from kb.model.problem import Problem
from kb.terms import Function
from tests.places import BUNDLED as DOMAINS

HERE = Path(__file__).parent
GOLDEN = sorted(
    path
    for path in DOMAINS.glob("*/golden/*.json")
    if '"status": "found"' in path.read_text(encoding="utf-8")
)


@dataclass(frozen=True)
class Example:
    """A plan with its problem, the world, the initial state and what was learned from it."""

    problem: Problem
    plan: Plan
    world: CellDomain
    initial: State
    learned: Generalised


def example(problem: Problem, plan: Plan) -> Example:
    world = CellDomain(problem)
    initial = Semantics(problem).initial()
    return Example(problem, plan, world, initial, generalise(problem, plan, world, initial))


@functools.cache
def golden(path: Path) -> Example:
    return example(*load_plan(path))


def bundled(name: str) -> Example:
    domain, problem = name.split("/")
    return golden(DOMAINS / domain / "golden" / f"{problem}.json")


def atom(text: str) -> Function:
    from kb.asp import ground_term

    found = ground_term(text)
    assert isinstance(found, Function)
    return found


@functools.cache
def figure_4() -> Example:
    """The five steps of the paper's figure 4, by the paper's own operators."""
    problem = load(HERE / "ita" / "one_point.yaml").problem
    assert problem is not None
    names = [
        "move_retract(t3_746, m1)",
        "move(t3_746, meas(m1), meas(m2))",
        "apply_couplant(t3_746, m2)",
        "move_contact(t3_746, m2)",
        "us_measure(us_probe, t3_746, m2)",
    ]
    arm, tool = Function("t3_746"), Function("us_probe")
    steps = tuple(
        Step(StepId(n), atom(name), (StepId(n - 1),) if n > 1 else (), (tool, arm) if n == 5 else (arm,))
        for n, name in enumerate(names, 1)
    )
    return example(problem, Plan(steps))
