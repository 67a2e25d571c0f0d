"""Makes a plan from a MACROP and values for its variables."""

from collections.abc import Mapping

from engine.stages.macros.lifted.schema import NotGeneral
from kb.arithmetic import evaluate
from kb.model.macro import Macrop, MacroStep
from kb.model.plan import CausalLink, Plan, Step
from kb.terms import Number, Term, Variable, is_ground, substitute, substitute_atom


def instantiate(macrop: Macrop, bindings: Mapping[Variable, Term]) -> Plan:
    """The plan of a MACROP under `bindings`. Raises `NotGeneral` if a variable of a step has no value."""
    steps = tuple(_step(step, bindings) for step in macrop.steps)
    made = {each: substitute_atom(each, bindings) for each in {link.condition for link in macrop.links}}
    links = tuple(CausalLink(link.producer, made[link.condition], link.consumer) for link in macrop.links)
    return Plan(steps, links)


def _step(step: MacroStep, bindings: Mapping[Variable, Term]) -> Step:
    operator = substitute_atom(step.operator, bindings)
    if not is_ground(operator):
        raise NotGeneral(f"{operator} has a variable without a value")
    resources = tuple([substitute(each, bindings) for each in step.resources])
    duration, cost = _number(step.duration, bindings), _number(step.cost, bindings)
    return Step(step.id, operator, step.after, resources, duration, cost)


def _number(term: Term, bindings: Mapping[Variable, Term]) -> int:
    if isinstance(term, Number):
        return term.value
    found = evaluate(substitute(term, bindings))
    return found.value if isinstance(found, Number) else 0
