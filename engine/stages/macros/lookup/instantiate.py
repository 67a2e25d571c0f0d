"""Makes a plan from a MACROP and values for its variables."""

from collections.abc import Mapping

from cellwright.engine.stages.macros.lifted.schema import NotGeneral
from cellwright.kb.model.amounts import Amounts, NoAmount
from cellwright.kb.model.macro import Macrop, MacroStep
from cellwright.kb.model.plan import CausalLink, Plan, Step
from cellwright.kb.terms import Term, Variable, is_ground, substitute, substitute_atom


def instantiate(macrop: Macrop, bindings: Mapping[Variable, Term], amounts: Amounts) -> Plan:
    """The plan of a MACROP under `bindings`.

    Raises `NotGeneral` if a variable of a step, its duration or its cost has no value.
    """
    steps = tuple(_step(step, bindings, amounts) for step in macrop.steps)
    made = {each: substitute_atom(each, bindings) for each in {link.condition for link in macrop.links}}
    links = tuple(CausalLink(link.producer, made[link.condition], link.consumer) for link in macrop.links)
    return Plan(steps, links)


def _step(step: MacroStep, bindings: Mapping[Variable, Term], amounts: Amounts) -> Step:
    operator = substitute_atom(step.operator, bindings)
    if not is_ground(operator):
        raise NotGeneral(f"{operator} has a variable without a value")
    resources = tuple([substitute(each, bindings) for each in step.resources])
    try:
        duration, cost = amounts.of(step.duration, bindings, 0), amounts.of(step.cost, bindings, 1)
    except NoAmount as error:
        raise NotGeneral(str(error)) from None
    return Step(step.id, operator, step.after, resources, duration, cost)
