"""What an operator measures: the part `measures` of its command."""

from collections.abc import Collection, Iterator

from cellwright.kb.diagnostics import nearest
from cellwright.kb.loader.counted import Counted
from cellwright.kb.loader.inference import Typing
from cellwright.kb.loader.names import Names
from cellwright.kb.loader.reader import Expression, Reader
from cellwright.kb.model.domain import Measure
from cellwright.kb.terms import Number, Term, Variable, variables

TERMS = ("of", "by", "value")
NUMBERS = {
    "nominal": "int", "tolerance": "int", "lower": "int", "upper": "int", "uncertainty": "int", "risk": "int", "worth": "time",
    "usual": "int",
}  # fmt: skip
SIGNED = ("nominal", "lower", "upper", "usual")


class MeasureReader:
    """Reads what one operator measures. Its numbers are like those of durations."""

    def __init__(self, reader: Reader, names: Names, path: tuple[str, ...]) -> None:
        self.reader, self.names, self.path = reader, names, (*path, "command", "measures")
        found = ((name, reader.expression("term", *self.path, name)) for name in (*TERMS, *NUMBERS))
        self.given = {name: expression for name, expression in found if expression is not None}

    def infer(self, typing: Typing) -> None:
        """What its numbers say of the types of variables."""
        for name, type_ in NUMBERS.items():
            if expression := self.given.get(name):
                Counted(self.names, typing, name, type_, expression, signed=name in SIGNED).check()

    def read(self, operator: str, header: Collection[Variable], reply: Term | None) -> Measure | None:
        """What is measured; None if nothing is, or if it cannot be read. What is wrong with it goes to the findings."""
        if "of" not in self.given or "value" not in self.given:
            return None
        heard = [*variables(reply)] if reply is not None else []
        self._refuse_strangers([*header], heard)
        self._refuse_nonsense()
        value = self.given["value"].value
        if not isinstance(value, Variable):
            return None
        terms = {name: expression.value for name, expression in self.given.items() if name != "value"}
        return Measure(
            value=value,
            unit=self.reader.text(*self.path, "unit"),
            quantity=self.reader.text(*self.path, "quantity") or operator,
            where=self.given["of"].node.where,
            **terms,
        )

    def _refuse_strangers(self, header: list[Variable], heard: list[Variable]) -> None:
        value = self.given["value"]
        if value.value not in heard:
            hint = (
                nearest(str(value.value), [*map(str, heard)]) or "let the reply bind it: `reply: value(Val)`"
            )
            message = f"the measured value {value.value} is no variable of the reply"
            self.names.findings.add(value.node.where, "K105", message, hint)
        for name, expression in self.given.items():
            for variable in variables(expression.value) if name != "value" else ():
                if variable not in header:
                    hint = nearest(str(variable), [*map(str, header)]) or "add it to the header"
                    message = f"the variable {variable} is not in the header"
                    self.names.findings.add(expression.place(variable), "K105", message, hint)

    def _refuse_nonsense(self) -> None:
        for place, message, hint in (*_nonsense(self.given), *_unsure(self.given)):
            self.names.findings.add(place.node.where, "K316", message, hint)


def _nonsense(given: dict[str, Expression]) -> Iterator[tuple[Expression, str, str]]:
    """What contradicts itself in the limits of a measurement, where, and what to try."""
    tolerance, limits = given.get("tolerance"), [given[each] for each in ("lower", "upper") if each in given]
    if tolerance is not None and limits:
        yield tolerance, "both a tolerance and limits are given", "keep the tolerance, or `lower` and `upper`"
    if tolerance is not None and "nominal" not in given:
        yield tolerance, "a tolerance without a nominal value", "add `nominal`, or give `lower` and `upper`"
    if tolerance is not None and tolerance.value == Number(0):
        yield tolerance, "nothing passes a tolerance of 0", "give how wide the zone is"
    values = [each.value.value for each in limits if isinstance(each.value, Number)]
    if len(values) == 2 and values[0] > values[1]:
        yield limits[0], f"the lower limit {values[0]} is above the upper limit {values[1]}", "exchange them"


def _unsure(given: dict[str, Expression]) -> Iterator[tuple[Expression, str, str]]:
    """What contradicts itself in what is said of the uncertainty of a measurement."""
    if "uncertainty" not in given:
        for name in ("risk", "worth"):
            if name in given:
                yield (
                    given[name],
                    f"a {name} without an uncertainty",
                    "add `uncertainty`: two standard deviations",
                )
    risk = given.get("risk")
    if risk is not None and isinstance(risk.value, Number) and not 0 < risk.value.value < 50:
        yield risk, f"a risk of {risk.value} percent", "write more than 0 and less than 50"
