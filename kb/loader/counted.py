"""Types within durations and costs: numbers, variables of numeric types, and what stands for a number."""

from dataclasses import dataclass

from cellwright.kb.loader.inference import Typing
from cellwright.kb.loader.names import Names
from cellwright.kb.loader.reader import Expression
from cellwright.kb.model.amounts import asks
from cellwright.kb.model.conventions import CONVENTIONS
from cellwright.kb.model.domain import NUMERIC_TYPES, OBJECT
from cellwright.kb.model.motion import DISTANCE
from cellwright.kb.terms import Function, Number, Operation, Term, Variable

UNDECLARED = (
    CONVENTIONS["travel"].role,
    DISTANCE,
)  # what a duration may ask for once a domain declares how an arm moves


@dataclass(frozen=True, slots=True)
class Counted:
    """A duration or cost of an operator: what is wrong with it goes to the findings, what it says of types to the typing."""

    names: Names
    typing: Typing
    name: str
    type_: str
    expression: Expression
    signed: bool = False  # whether it may be negative

    def check(self) -> None:
        """Read the expression through."""
        value = self.expression.value
        if isinstance(value, Number) and value.value < 0 and not self.signed:
            hint, said = f"a {self.name} must be 0 or more", f"the {self.name} {value} is negative"
            self.names.findings.add(self.expression.node.where, "K113", said, hint)
        self._term(value)

    def _term(self, term: Term) -> None:
        match term:
            case Variable():
                self._numeric(term)
            case Operation(_, left, right):
                self._term(left)
                self._term(right)
            case Function(known, arguments) if asks(
                self.names.predicates, self.names.travel, known, len(arguments)
            ):
                declared = self.names.predicates.get(known)
                types = declared.arguments if declared else (OBJECT, OBJECT)
                for argument, expected in zip(arguments, types, strict=False):
                    self.typing.term(argument, expected, self.expression, term)
            case Function(known, (_, _)) if known in UNDECLARED and known not in self.names.functions:
                hint = "declare `motion:` with a speed, or the static travel(place, place, time)"
                message = f"no motion is declared, so '{known}' is not known"
                self.names.findings.add(self.expression.place(term), "K101", message, hint)
                self.typing.sound = False
            case _:
                self.typing.term(term, self.type_, self.expression, Function(self.name))

    def _numeric(self, variable: Variable) -> None:
        if (known := self.typing.type_of(variable)) is None:
            self.typing.types[variable] = self.type_
        elif known not in NUMERIC_TYPES:
            message = f"{variable} is of type {known}, but a {self.name} is a number"
            hint = "bind a number by a static: `takes(Item, Time)` in `where:`"
            self.names.findings.add(self.expression.place(variable), "K103", message, hint)
