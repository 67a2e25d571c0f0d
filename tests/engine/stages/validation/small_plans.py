"""Small cells, problems and plans, written as people write them."""

import functools
import tempfile
from pathlib import Path

from cellwright.engine.stages.validation import validate_plan
from cellwright.kb.asp import ground_term
from cellwright.kb.loader import load
from cellwright.kb.model.plan_model import CausalLink, Plan, Step, StepId
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Function, Term

CELL = """domain: cell
types:
  item: object
  place: object
objects:
  item: [bolt, nut]
  place: [table, bin]
statics:
  heavy(item): {}
fluents:
  at(item, place): {}
  lit: {}
  dirty: {}
  clean: {}
events:
  seen(item): {}
operators:
  move(Item, From, To):
    where: From != To, not heavy(Item)
    preconditions: at(Item, From)
    adds: at(Item, To)
    resources: arm, Item
  drop(Item, Place): {adds: "at(Item, Place)"}
  light: {adds: lit}
  douse: {deletes: lit}
  look(Item): {preconditions: lit, adds: seen(Item)}
  wipe: {adds: clean}
  rub: {preconditions: not clean, adds: dirty}
deductive_operators:
  - when: at(Item, Place)
    denies: at(Item, Other), Other != Place
"""
AT_HOME = ("at(bolt, table)", "at(nut, table)")


def problem(
    goals: str = "",
    initial: tuple[str, ...] = AT_HOME,
    domain: str = CELL,
    workflow: tuple[str, ...] = (),
    statics: tuple[str, ...] = (),
    objects: str = "",
    rules: str = "",
) -> Problem:
    """A problem of a cell; each entry of `workflow` is a YAML flow mapping, `rules` are what
    the domain includes.
    """
    lines = ["problem: task", "domain: domain.yaml"]
    lines += ["objects:", f"  {objects}"] if objects else []
    lines += ["statics:", *(f'  - "{fact}"' for fact in statics)] if statics else []
    lines += ["initial:", *(f'  - "{fact}"' for fact in initial)] if initial else []
    lines += ["goals:", f'  - "{goals}"'] if goals else []
    lines += ["workflow:", *(f"  - {chain}" for chain in workflow)] if workflow else []
    return _loaded(domain, "\n".join(lines) + "\n", rules)


@functools.cache
def _loaded(domain: str, text: str, rules: str) -> Problem:
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "domain.yaml").write_text(domain)
        (Path(folder) / "rules.lp").write_text(rules)
        (Path(folder) / "problem.yaml").write_text(text)
        found = load(Path(folder) / "problem.yaml").problem
    assert found is not None
    return found


def term(text: str) -> Term:
    """A ground term from its text."""
    return ground_term(text)


def atom(text: str) -> Function:
    """A ground atom from its text."""
    found = ground_term(text)
    assert isinstance(found, Function)
    return found


def step(number: int, operator: str, *after: int, holds: tuple[str, ...] = ()) -> Step:
    """A step after others, which holds resources."""
    return Step(StepId(number), atom(operator), tuple(map(StepId, after)), tuple(map(term, holds)))


def link(producer: int, condition: str, consumer: int) -> CausalLink:
    """A causal link; 0 is the start, -1 the goal, `not(p)` a condition that p is false."""
    return CausalLink(StepId(producer), atom(condition), StepId(consumer))


def wrong(posed: Problem, steps: tuple[Step, ...], links: tuple[CausalLink, ...] = ()) -> list[str]:
    """What the checker has against a plan, each as `code: message`."""
    return [f"{each.code}: {each.message}" for each in validate_plan(posed, Plan(steps, links))]
