"""What the instances of an operator hold, how long they last and what they cost."""

from dataclasses import dataclass

from cellwright.kb.model.amounts import Amounts, NoAmount
from cellwright.kb.model.domain import Operator
from cellwright.kb.model.traits import traits
from cellwright.kb.terms import Function, Term, variables


@dataclass(frozen=True, slots=True)
class Amiss:
    """An instance of an operator whose duration or cost is no amount: `code`, what is wrong, and what to try."""

    operator: Operator
    code: str
    message: str
    hint: str


Traits = tuple[tuple[Term, ...], int, int]  # resources, duration, cost


class Shared:
    """The resources, the duration and the cost of an operator's instances.

    They are computed once for each combination of the arguments that they depend on.
    """

    def __init__(self, operator: Operator, amounts: Amounts, amiss: dict[tuple[str, str], Amiss]) -> None:
        self.operator, self.amounts, self.amiss = operator, amounts, amiss
        terms = [
            *operator.resources,
            *(each for each in (operator.duration, operator.cost) if each is not None),
        ]
        named = {variable for term in terms for variable in variables(term)}
        alone = any(each.name == operator.name for each in amounts.measured)
        self.places = [place for place, each in enumerate(operator.variables) if alone or each in named]
        self.known: dict[tuple[int, ...], Traits | None] = {}

    def of(self, row: list[int], instance: Function) -> Traits | None:
        """The traits of the instance in `row`; None if a resource has no value, so that there is no such instance."""
        key = tuple([row[place] for place in self.places])
        if key not in self.known:
            self.known[key] = self._evaluated(instance)
        return self.known[key]

    def _evaluated(self, instance: Function) -> Traits | None:
        try:
            found = traits(self.operator, instance, self.amounts)
        except NoAmount as error:
            message = f"{error}, so nobody can tell how long {instance} takes or what it costs"
            self._note("K115", message, error.hint)
            return None
        if found is None:
            return None
        for name, value in (("duration", found.duration), ("cost", found.cost)):
            if value < 0:
                hint = f"a {name} must be 0 or more: exclude such instances in `where:`"
                self._note("K113", f"the {name} of {instance} is {value}", hint, name)
        return found.resources, found.duration, found.cost

    def _note(self, code: str, message: str, hint: str, name: str = "") -> None:
        """Note what is wrong, unless the operator has another instance with the same fault."""
        key = (self.operator.name, code + name)
        self.amiss.setdefault(key, Amiss(self.operator, code, message, hint))
