"""What is said of a text that the grammar refuses: what is wrong, where, and what to try."""

import re

from lark import UnexpectedCharacters, UnexpectedEOF, UnexpectedInput, UnexpectedToken

from cellwright.kb.syntax.checks import ExpressionError

_READABLE = {
    "RPAR": "')'", "LPAR": "'('", "COMMA": "','", "NAME": "a name", "VARIABLE": "a variable", "SEMICOLON": "';'",
    "RELATION": "a comparison", "VBAR": "'|'", "SIGNED_INT": "a number", "STRING": "a string",
}  # fmt: skip


def explained(error: UnexpectedInput, text: str, start: str) -> ExpressionError:
    """The error of a text that was read as `start`, one of the starts of the grammar."""
    match error:
        case UnexpectedCharacters(pos_in_stream=position):
            found = text[position or 0]
            hint = _CHARACTER_HINTS.get(found, _SHAPES[start])
            return ExpressionError(position or 0, f"unexpected '{found}'", hint)
        case UnexpectedToken(token=token) if token.type != "$END":
            said, offset = f"unexpected '{token}'", token.start_pos or 0
        case UnexpectedToken() | UnexpectedEOF() | _:
            said, offset = "the expression ends too early", len(text.rstrip())
    expected = getattr(error, "accepts", None) or getattr(error, "expected", None) or ()
    readable = sorted(_READABLE[name] for name in expected if name in _READABLE)
    hint = _TOKEN_HINTS.get(":" if text[:offset].rstrip().endswith(":") else text[offset : offset + 1], "")
    if start in ("atoms", "stages", "clauses") and re.search(r"\bnot\s+$", text[:offset]):
        hint = _NOT_HINT
    if text[offset : offset + 1] == "|" and (
        start in ("term", "terms") or not re.search(r"[\w)]\s*$", text[:offset])
    ):
        hint = _ABSOLUTE_HINT
    hint = hint or (f"expected {' or '.join(readable)}" if readable else _SHAPES[start])
    return ExpressionError(offset, said, hint)


_NOT_HINT = "`not` is only allowed in conditions; facts that are not listed are false, and `deletes` and `denies` make facts false"
_ABSOLUTE_HINT = (
    "absolute values are known in .lp files: derive a fact with one there, and bind its number under `where`"
)
_ATOMS, _CONDITIONS = (
    "atoms, such as at(Item, To), with commas between",
    "atoms and comparisons, such as not heavy(Item), X != Y",
)
_TOGETHER = "write ',' for and, '|' for or; only in stages `&` joins what is reached together"
_SHAPES = {
    "header": "write name(Variable, ...)",
    "signature": "write name(type, ...)",
    "trigger": "one atom, or `not` and an atom",
    "atom": "one name or atom, such as at(bolt, table)",
    "term": "one name, number, variable, or a time such as 15 min (ms, s, min, h)",
    "terms": "names, variables and terms, with commas between",
    "clauses": "an atom and its constraints, such as at(Item, Other), Other != To",
    "atoms": _ATOMS,
    "stages": "atoms, such as at(Item, To), with commas between; `&` between those that are reached together",
    "conditions": _CONDITIONS,
    "body": _CONDITIONS,
}  # what each kind of expression looks like
_CHARACTER_HINTS = {
    ".": "an expression does not end with a full stop; ranges such as p_1..4 are only allowed in lists of objects",
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
