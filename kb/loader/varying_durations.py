"""Durations that nobody decides: `{from: 60 s, to: 90 s}`, `{usual: 70 s, spread: 5 s}`."""

from collections.abc import Iterator

from cellwright.kb.loader.numeric_expressions import NumericExpression
from cellwright.kb.loader.reader import Expression, Reader
from cellwright.kb.loader.symbol_table import SymbolTable
from cellwright.kb.loader.variable_types import Typing
from cellwright.kb.model.domain_model import SPREADS_EACH_WAY, VaryingDuration
from cellwright.kb.terms import Number, Operation, Term

VARYING_KEYS = ("from", "to", "usual", "spread")
BOTH_OR_SPREAD = "give `from` and `to`, or `usual` and `spread`"


class DurationReader:
    """Reads the varying duration of the operator at `path`; `given` is empty if it has none."""

    def __init__(self, reader: Reader, names: SymbolTable, path: tuple[str, ...]) -> None:
        self.names = names
        node = reader.root.descend((*path, "duration"))
        self.node = node
        self.is_varying = isinstance(node.value, dict) and "duration" in {
            key for key, _, _ in reader.entries(*path)
        }
        expressions = (
            (key, reader.expression("term", *path, "duration", key) if self.is_varying else None)
            for key in VARYING_KEYS
        )
        self.given = {key: expression for key, expression in expressions if expression is not None}

    def infer(self, typing: Typing) -> None:
        """What it says of the types of variables. What is wrong with it goes to the findings."""
        for expression in self.given.values():
            NumericExpression(self.names, typing, "duration", "time", expression).check()
        if self.is_varying:
            self._refuse_parts()
            for expression, message, hint in self._contradictions():
                self.names.findings.add(expression.node.where, "K113", message, hint)

    def _refuse_parts(self) -> None:
        has_range = "from" in self.given and "to" in self.given
        half = ("from" in self.given) is not ("to" in self.given)
        if half or not (has_range or {"usual", "spread"} <= {*self.given}):
            message = "the least or the greatest duration is missing"
            self.names.findings.add(self.node.where, "K005", message, BOTH_OR_SPREAD)

    def _contradictions(self) -> Iterator[tuple[Expression, str, str]]:
        """What the numbers say that cannot be: where, what, and what to try."""
        numbers = {
            key: expression.value.value
            for key, expression in self.given.items()
            if isinstance(expression.value, Number)
        }
        least, most, usual = (numbers.get(key) for key in ("from", "to", "usual"))
        if least is not None and most is not None and least > most:
            message = f"a step that takes from {least} to {most} takes no time at all"
            yield self.given["to"], message, "exchange `from` and `to`"
        elif usual is not None and not (
            (least is None or least <= usual) and (most is None or usual <= most)
        ):
            message = f"the usual duration {usual} is outside of its range"
            yield self.given["usual"], message, "widen the range, or correct `usual`"

    def usual(self, plain: Term | None) -> Term | None:
        """What is planned with; `plain` where the duration does not vary."""
        if not self.is_varying:
            return plain
        if "usual" in self.given:
            usual: Term = self.given["usual"].value
            return usual
        if "from" in self.given and "to" in self.given:
            return _half(self.given["from"].value, self.given["to"].value)
        return None

    def varies(self) -> VaryingDuration | None:
        """Within what it varies; None where it does not."""
        if not self.is_varying:
            return None
        terms = {key: expression.value for key, expression in self.given.items()}
        spread = terms.get("spread")
        if "from" in terms and "to" in terms:
            return VaryingDuration(terms["from"], terms["to"], spread)
        if spread is None or "usual" not in terms:
            return None
        reach = Operation("*", Number(SPREADS_EACH_WAY), spread)
        usual = terms["usual"]
        return VaryingDuration(Operation("-", usual, reach), Operation("+", usual, reach), spread)


def _half(least: Term, most: Term) -> Term:
    if isinstance(least, Number) and isinstance(most, Number):
        return Number((least.value + most.value) // 2)
    return Operation("/", Operation("+", least, most), Number(2))
