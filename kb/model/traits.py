"""What an instance of an operator holds, how long it lasts and what it costs, as its domain says."""

from dataclasses import dataclass

from cellwright.kb.arithmetic import evaluate
from cellwright.kb.model.amounts import Amounts, NoAmount
from cellwright.kb.model.domain import Operator
from cellwright.kb.model.plan import Step, StepId
from cellwright.kb.terms import Function, Term, substitute


@dataclass(frozen=True, slots=True)
class Traits:
    """The resources of an instance, its duration in the domain's unit of time, and its cost."""

    resources: tuple[Term, ...] = ()
    duration: int = 0
    cost: int = 1


def traits(operator: Operator, instance: Function, amounts: Amounts) -> Traits | None:
    """The traits of an instance; None if a resource has no value, so that there is no such instance.

    Raises `NoAmount` if its duration or cost cannot be told.
    """
    bindings = dict(zip(operator.variables, instance.arguments, strict=True))
    resources = [evaluate(substitute(resource, bindings)) for resource in operator.resources]
    held = tuple([each for each in resources if each is not None])
    duration, cost = amounts.lasting(operator, bindings), amounts.of(operator.cost, bindings, 1)
    if len(held) < len(resources):
        return None
    return Traits(held, duration, cost)


def step_of(amounts: Amounts, number: StepId, instance: Function, after: tuple[StepId, ...] = ()) -> Step:
    """A step with the traits that its domain gives it; those of no operator if it is no instance, or they cannot be told.

    The checker refuses such a step.
    """
    known = next((each for each in amounts.domain.operators if each.name == instance.name), None)
    fits = known is not None and len(known.parameters) == len(instance.arguments)
    try:
        found = (traits(known, instance, amounts) if known and fits else None) or Traits()
    except NoAmount:
        found = Traits()
    return Step(number, instance, after, found.resources, found.duration, found.cost)
