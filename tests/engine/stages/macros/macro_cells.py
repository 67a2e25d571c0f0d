"""Plans and worlds for the tests of macros: golden plans of the bundled cells, and the paper's
own operators.
"""

import dataclasses
import functools
from dataclasses import dataclass
from pathlib import Path

from cellwright.engine.stages.lifted.cell_domain import CellDomain, State
from cellwright.engine.stages.lifted.fact_queries import is_satisfiable
from cellwright.engine.stages.macros.learning.macro_extraction import GeneralisedPlan
from cellwright.engine.stages.macros.learning.plan_generalisation import generalise_plan
from cellwright.engine.stages.validation.operator_semantics import Semantics
from cellwright.kb.loader import load
from cellwright.kb.loader.plan import load_plan
from cellwright.kb.model.conditions import And, Literal, part_variables
from cellwright.kb.model.plan_model import Macrop, Plan, Step, StepId
from cellwright.kb.model.planning_problem import Chain, Problem
from cellwright.kb.terms import (
    Function,
    Term,
    Variable,
    substitute_atom,
    substitute_term,
    term_variables,
)
from tests.places import BUNDLED as DOMAINS

HERE = Path(__file__).parent
GOLDEN = sorted(
    path
    for path in DOMAINS.glob("*/golden/*.json")
    if not {"handey", "centrifuge", "gauging", "elisa", "screening"}
    & {*path.parts}  # conditions on all parts, and quantities: no MACROP has them
    and '"status": "infeasible"' not in path.read_text(encoding="utf-8")
)


@dataclass(frozen=True)
class Example:
    """A plan with its problem, the world, the initial state and what was learned from it."""

    problem: Problem
    plan: Plan
    world: CellDomain
    initial: State
    learned: GeneralisedPlan


def example(problem: Problem, plan: Plan) -> Example:
    world = CellDomain(problem)
    initial = Semantics(problem).initial()
    return Example(problem, plan, world, initial, generalise_plan(problem, plan, world, initial))


@functools.cache
def golden(path: Path) -> Example:
    return example(*load_plan(path))


def bundled(name: str) -> Example:
    domain, problem = name.split("/")
    return golden(DOMAINS / domain / "golden" / f"{problem}.json")


def atom(text: str) -> Function:
    from cellwright.kb.asp import ground_term

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
        Step(
            StepId(n),
            atom(name),
            (StepId(n - 1),) if n > 1 else (),
            (tool, arm) if n == 5 else (arm,),
        )
        for n, name in enumerate(names, 1)
    )
    return example(problem, Plan(steps))


def constraints_hold(macrop: Macrop, world: CellDomain, bindings: dict[Variable, Term]) -> bool:
    """Whether an instance satisfies all that its MACROP demands of terms."""
    typed = all(world.statics.has_type(bindings[p.variable], p.type) for p in macrop.types)
    existential = {v for part in macrop.constraints for v in part_variables(part)} - {
        v for s in macrop.steps for v in term_variables(s.operator)
    }
    known = {v: t for v, t in bindings.items() if v not in existential}
    body = (*macrop.constraints, *macrop.disequalities)
    excluded = any(is_satisfiable(each, world.statics, known) for each in macrop.exclusions)
    return typed and not excluded and is_satisfiable(body, world.statics, known)


def posed(found: Example, bindings: dict[Variable, Term]) -> Problem:
    """The problem of reaching an instance's goals from the instance's own preconditions."""
    macrop = found.learned.macrop
    chains = tuple(
        Chain(
            str(substitute_term(chain.name, bindings)).strip('"'),
            tuple(substitute_atom(stage, bindings) for stage in chain.stages),
            tuple(str(substitute_term(name, bindings)).strip('"') for name in chain.after),
            substitute_term(chain.subject, bindings) if chain.subject is not None else None,
        )
        for chain in macrop.chains
    )
    initial = tuple(
        dict.fromkeys(substitute_atom(p.atom, bindings) for p in macrop.preconditions if p.positive)
    )
    goals = And(tuple(Literal(substitute_atom(g.atom, bindings), g.positive) for g in macrop.goals))
    return dataclasses.replace(
        found.problem, goal=goals, chains=chains, initial=initial, complete=True
    )
