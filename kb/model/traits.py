"""What an instance of an operator holds, how long it lasts and what it costs, as its domain says."""

from dataclasses import dataclass

from kb.arithmetic import amount, evaluate
from kb.model.domain import Domain, Operator
from kb.model.plan import Step, StepId
from kb.terms import Function, Term, substitute


@dataclass(frozen=True, slots=True)
class Traits:
    """The resources of an instance, its duration in the domain's unit of time, and its cost."""

    resources: tuple[Term, ...] = ()
    duration: int = 0
    cost: int = 1


def traits(operator: Operator, instance: Function) -> Traits | None:
    """The traits of an instance; None if one of them has no value, so that there is no such instance."""
    bindings = dict(zip(operator.variables, instance.arguments, strict=True))
    resources = [evaluate(substitute(resource, bindings)) for resource in operator.resources]
    held = tuple([each for each in resources if each is not None])
    duration, cost = amount(operator.duration, bindings, 0), amount(operator.cost, bindings, 1)
    if duration is None or cost is None or len(held) < len(resources):
        return None
    return Traits(held, duration, cost)


def step_of(domain: Domain, number: StepId, instance: Function, after: tuple[StepId, ...] = ()) -> Step:
    """A step with the traits that its domain gives it; those of no operator if it is no instance."""
    known = {operator.name: operator for operator in domain.operators}.get(instance.name)
    fits = known is not None and len(known.parameters) == len(instance.arguments)
    found = (traits(known, instance) if known and fits else None) or Traits()
    return Step(number, instance, after, found.resources, found.duration, found.cost)
