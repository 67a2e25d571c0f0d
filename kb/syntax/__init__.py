"""The language inside YAML strings, parsed into terms and conditions with one LALR grammar."""

import functools
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Any

from lark import (
    Lark,
    Token,
    Transformer,
    UnexpectedCharacters,
    UnexpectedEOF,
    UnexpectedInput,
    UnexpectedToken,
    v_args,
)
from lark.exceptions import VisitError

from cellwright.kb.model.condition_forms import free_variables
from cellwright.kb.model.conditions import (
    Aggregate,
    Comparison,
    Condition,
    ForAll,
    Literal,
    Not,
    Or,
    Parameter,
)
from cellwright.kb.model.statement import Statement
from cellwright.kb.plain_terms import plain_terms
from cellwright.kb.syntax.expression_checks import ExpressionError, check_brackets, check_size
from cellwright.kb.syntax.grammar_tables import TABLES_FILE, load_parser, tables_text
from cellwright.kb.terms import (
    Function,
    Number,
    Operation,
    Term,
    Text,
    Variable,
    join_stage,
    term_variables,
)

_READABLE = {
    "RPAR": "')'", "LPAR": "'('", "COMMA": "','", "NAME": "a "
    "name", "VARIABLE": "a variable", "SEMICOLON": "';'",
    "RELATION": "a comparison", "VBAR": "'|'", "SIGNED_INT": "a number", "STRING": "a string",
}  # fmt: skip


def explain_error(error: UnexpectedInput, text: str, start: str) -> ExpressionError:
    """The error of a text that was read as `start`, one of the starts of the grammar."""
    match error:
        case UnexpectedCharacters(pos_in_stream=position):
            character = text[position or 0]
            hint = _CHARACTER_HINTS.get(character, _START_SHAPES[start])
            return ExpressionError(position or 0, f"unexpected '{character}'", hint)
        case UnexpectedToken(token=token) if token.type != "$END":
            said, offset = f"unexpected '{token}'", token.start_pos or 0
        case UnexpectedToken() | UnexpectedEOF() | _:
            said, offset = "the expression ends too early", len(text.rstrip())
    expected = getattr(error, "accepts", None) or getattr(error, "expected", None) or ()
    readable = sorted(_READABLE[name] for name in expected if name in _READABLE)
    hint = _TOKEN_HINTS.get(
        ":" if text[:offset].rstrip().endswith(":") else text[offset : offset + 1], ""
    )
    if start in ("atoms", "stages", "clauses") and re.search(r"\bnot\s+$", text[:offset]):
        hint = _NOT_HINT
    if text[offset : offset + 1] == "|" and (
        start in ("term", "terms") or not re.search(r"[\w)]\s*$", text[:offset])
    ):
        hint = _ABSOLUTE_HINT
    hint = hint or (f"expected {' or '.join(readable)}" if readable else _START_SHAPES[start])
    return ExpressionError(offset, said, hint)


_NOT_HINT = (
    "`not` is only allowed in conditions; facts that are not listed are false, and `deletes` "
    "and `denies` make facts false"
)
_ABSOLUTE_HINT = (
    "absolute values are known in .lp files: derive a fact with one there, and bind its number "
    "under `where`"
)
_ATOMS, _CONDITIONS = (
    "atoms, such as at(Item, To), with commas between",
    "atoms and comparisons, such as not heavy(Item), X != Y",
)
_TOGETHER = "write ',' for and, '|' for or; only in stages `&` joins what is reached together"
_START_SHAPES = {
    "header": "write name(Variable, ...)",
    "signature": "write name(type, ...)",
    "trigger": "one atom, or `not` and an atom",
    "atom": "one name or atom, such as at(bolt, table)",
    "term": "one name, number, variable, or a time such as 15 min (ms, s, min, h)",
    "terms": "names, variables and terms, with commas between",
    "clauses": "an atom and its constraints, such as at(Item, Other), Other != To",
    "atoms": _ATOMS,
    "stages": "atoms, such as at(Item, To), with commas between; `&` between those that are "
    "reached "
    "together",
    "conditions": _CONDITIONS,
    "body": _CONDITIONS,
}  # what each kind of expression looks like
_CHARACTER_HINTS = {
    ".": "an expression does not end with a full stop; ranges such as p_1..4 are only allowed in "
    "lists of objects",
    "&": _TOGETHER,
    "!": "write `not` before the atom",
    "-": "write `not` before the atom",
    "'": "write texts in double quotes",
    "@": "there are no external functions",
    "#": "only #count, #sum, #min and #max are known, each with { }",
    "{": "write #count, #sum, #min or #max before a set",
}
_TOKEN_HINTS = {
    "&": _TOGETHER,
    ";": "';' separates alternatives of `implies` and `denies`; elsewhere ',' means and",
    ":": "write rules in .lp files; `p(X) : q(X)` is a condition",
    "|": "write `a(X) | b(X)` between atoms of a condition",
}


__all__ = [
    "GRAMMAR_STARTS",
    "SECONDS_PER_UNIT",
    "ExpressionError",
    "Parsed",
    "ReadAggregate",
    "parse_expression",
    "unit_seconds",
]

GRAMMAR_FILE = Path(__file__).with_name("expressions.lark")
GRAMMAR_STARTS = [
    "header",
    "trigger",
    "conditions",
    "body",
    "clauses",
    "atoms",
    "stages",
    "atom",
    "term",
    "terms",
]
GRAMMAR_STARTS += ["signature"]
SHORT_EXPRESSION_CHARACTERS = 1000  # characters
MAX_EXPRESSION_INTEGER = 2**31 - 1  # clingo counts in 32 bits, and overflows silently
SECONDS_PER_UNIT = {
    "ms": Fraction(1, 1000),
    "s": Fraction(1),
    "min": Fraction(60),
    "h": Fraction(3600),
}


ReadAggregate = Callable[[str, int], Statement]
"""An aggregate's text and where it begins, read by others as the constraint that forbids it;
raises `ExpressionError`.
"""


@dataclass(frozen=True, slots=True)
class Parsed:
    """The value of a text, and the first place of each function and variable in it (offsets in
    characters).
    """

    value: Any
    places: Mapping[Function | Variable, int] = field(default_factory=dict)


def unit_seconds(name: str) -> Fraction | None:
    """Seconds in one unit of time given by name or abbreviation; None for an unknown name."""
    if name in SECONDS_PER_UNIT:
        return SECONDS_PER_UNIT[name]
    return next(
        (
            SECONDS_PER_UNIT[short]
            for short in ("s", "min", "h")
            if re.fullmatch(_SPELLINGS[short], name)
        ),
        None,
    )


_SPELLINGS = {"s": "sec|secs|seconds?", "min": "mins|minutes?", "h": "hours?"}


@v_args(inline=True)
class _Reader(Transformer[Token, Any]):
    """Builds terms and conditions bottom-up, and notes the place of each function and variable."""

    def __init__(self, time_unit: str, read_aggregate: ReadAggregate | None) -> None:
        super().__init__()
        self.unit = SECONDS_PER_UNIT[time_unit]
        self.read_aggregate = read_aggregate
        self.places: dict[Function | Variable, int] = {}

    def _place(self, function: Function, token: Token) -> Function:
        offset = token.start_pos or 0
        if function.name == "not":
            raise ExpressionError(
                offset, "'not' is not a name", "write `not p(X)`: a space and an atom", "K112"
            )
        if function.name.startswith("_"):
            hint = "names that begin with '_' belong to the engine"
            raise ExpressionError(offset, f"'{function.name}' is reserved", hint, "K112")
        self.places.setdefault(function, offset)
        return function

    def variable(self, token: Token) -> Variable:
        variable = Variable(str(token))
        self.places.setdefault(variable, token.start_pos or 0)
        return variable

    def number(self, token: Token) -> Number:
        return self._number(Fraction(_read_digits(token)), token)

    def _number(self, value: Fraction, token: Token) -> Number:
        offset = token.start_pos or 0
        if value.denominator != 1:
            hint = "choose a smaller unit under `units:`"
            message = f"'{token}' is not a whole number of the domain's unit of time"
            raise ExpressionError(offset, message, hint, "K113")
        if abs(value) > MAX_EXPRESSION_INTEGER:
            raise ExpressionError(
                offset,
                "this number is too large",
                f"the largest is {MAX_EXPRESSION_INTEGER}",
                "K113",
            )
        return Number(int(value))

    def duration(self, token: Token) -> Number:
        amount = re.match(r"[0-9.]+", token)
        unit = token[amount.end() :].strip() if amount else ""
        return self._number(
            Fraction(_read_digits(amount[0] if amount else ""))
            * (unit_seconds(unit) or 1)
            / self.unit,
            token,
        )

    def decimal(self, token: Token) -> Function:
        return Function(str(token))  # only in reply patterns, which clingo never reads

    def text(self, token: Token) -> Text:
        return Text(
            re.sub(r"\\(.)", lambda escape: "\n" if escape[1] == "n" else escape[1], token[1:-1])
        )

    def operation(self, left: Term, operator: Token, right: Term) -> Operation:
        return Operation(str(operator), left, right)

    def atom(self, name: Token, *arguments: Term | None) -> Function:
        return self._place(Function(str(name), tuple(a for a in arguments if a is not None)), name)

    def signature(self, name: Token, *types: Token | None) -> Function:
        inner = (
            self._place(Function(str(type_token)), type_token)
            for type_token in types
            if type_token is not None
        )
        return self._place(Function(str(name), tuple(inner)), name)

    def header(self, name: Token, *parameters: Token | None) -> Function:
        return self._place(
            Function(
                str(name),
                tuple(
                    self.variable(parameter) for parameter in parameters if parameter is not None
                ),
            ),
            name,
        )

    def literal(self, *children: Any) -> Literal:
        return Literal(children[-1], len(children) == 1)

    def comparison(self, left: Term, relation: Token, right: Term) -> Comparison:
        return Comparison(left, "=" if relation == "==" else str(relation), right)

    def aggregate(self, *children: Any) -> Aggregate:
        sign = "not " if children[0] == "not" else ""
        parts = children[1:] if sign else children
        (value,) = (part for part in parts if not isinstance(part, Token))
        text, outer = sign + " ".join(map(str, parts)), tuple(term_variables(value))
        bound = isinstance(value, Variable) and not sign and parts[1] in ("=", "==")
        if self.read_aggregate is None:
            return Aggregate(text, outer, value if bound else None, outer)
        start = min(part.start_pos or 0 for part in parts if isinstance(part, Token))
        read = self.read_aggregate(text, start)
        standing = tuple(map(Variable, read.variables))
        return Aggregate(
            text, outer, value if bound else None, standing, tuple(use for use, _ in read.uses)
        )

    def universal(self, literal: Literal, guard: Condition) -> ForAll:
        local = tuple(Parameter(variable, "") for variable in free_variables(guard))
        return ForAll(local, Or((Not(guard), literal)))

    def disjunction(self, *parts: Literal) -> Or:
        return Or(parts)

    def conditions(self, *parts: Condition) -> tuple[Condition, ...]:
        return parts

    def body(self, *parts: Condition) -> tuple[Condition, ...]:
        return parts

    def atoms(self, *parts: Function) -> tuple[Function, ...]:
        return parts

    def stage(self, *parts: Function) -> Function:
        return parts[0] if len(parts) == 1 else join_stage(parts)

    def stages(self, *parts: Function) -> tuple[Function, ...]:
        return parts

    def terms(self, *parts: Term) -> tuple[Term, ...]:
        return parts

    def clause(self, atom: Function, *body: Condition) -> tuple[Function, tuple[Condition, ...]]:
        return atom, body

    def clauses(self, *clauses: Any) -> tuple[Any, ...]:
        return clauses


def _read_digits(text: str) -> str:
    """The digits of a number.

    If there are too many, only enough of them to show that it is too large.
    """
    return text if len(text) <= 20 else "9" * 20


@functools.cache
def _load_grammar() -> Lark:
    return load_parser(GRAMMAR_FILE, GRAMMAR_STARTS)


def write_tables() -> None:
    """Make the tables of the grammar anew, and keep them beside it."""
    TABLES_FILE.write_text(tables_text(GRAMMAR_FILE.read_text("utf-8"), GRAMMAR_STARTS), "utf-8")


def parse_expression(
    start: str, text: str, time_unit: str = "s", read_aggregate: ReadAggregate | None = None
) -> Parsed:
    """Read `text` as one of `STARTS`; durations become numbers in `time_unit`. Raises
    `ExpressionError`.

    What stands inside an aggregate is ASP; it is unknown where nobody reads it. A short text is
    remembered: the domain is read anew with each of its problems.
    """
    read = _remembered if len(text) <= SHORT_EXPRESSION_CHARACTERS else _parse_uncached
    return read(start, text, time_unit, read_aggregate)


def _parse_uncached(
    start: str, text: str, time_unit: str, read_aggregate: ReadAggregate | None
) -> Parsed:
    plain = _parse_plain(start, text)
    if plain is not None:
        return Parsed(plain, _Places(start, text))
    return _parse_by_grammar(start, text, time_unit, read_aggregate)


def _parse_plain(start: str, text: str) -> Any:
    """What the grammar makes of a plain text, in a tenth of its time; None for any other."""
    if start not in _OF_TERMS or (read := plain_terms(text)) is None:
        return None
    if (
        start != "terms"
        and start != "term"
        and not all(isinstance(term, Function) for term in read)
    ):
        return None
    return _OF_TERMS[start](read)


def _only_term(read: tuple[Term, ...]) -> Term | None:
    return read[0] if len(read) == 1 else None


def _as_literals(read: tuple[Any, ...]) -> tuple[Literal, ...]:
    return tuple([Literal(atom) for atom in read])


_OF_TERMS: Mapping[str, Callable[[tuple[Any, ...]], Any]] = {
    "atoms": tuple, "stages": tuple, "terms": tuple, "atom": _only_term, "term": _only_term,
    "conditions": _as_literals, "body": _as_literals,
}  # fmt: skip


class _Places(Mapping[Function | Variable, int]):
    """The places in a plain text.

    They are found when somebody asks, which happens when something is wrong.
    """

    def __init__(self, start: str, text: str) -> None:
        self._start, self._text = start, text

    @functools.cached_property
    def _found(self) -> Mapping[Function | Variable, int]:
        return _parse_by_grammar(self._start, self._text, "s", None).places

    def __getitem__(self, term: Function | Variable) -> int:
        return self._found[term]

    def __iter__(self) -> Iterator[Function | Variable]:
        return iter(self._found)

    def __len__(self) -> int:
        return len(self._found)


def _parse_by_grammar(
    start: str, text: str, time_unit: str, read_aggregate: ReadAggregate | None
) -> Parsed:
    """`parse` by the grammar."""
    check_size(text)
    check_brackets(text)
    reader = _Reader(time_unit, read_aggregate)
    try:
        value = reader.transform(_load_grammar().parse(text, start))
    except VisitError as error:
        if isinstance(error.orig_exc, ExpressionError):
            raise error.orig_exc from None
        raise
    except UnexpectedInput as error:
        raise explain_error(error, text, start) from None
    return Parsed(value, reader.places)


_remembered = functools.lru_cache(4096)(_parse_uncached)
