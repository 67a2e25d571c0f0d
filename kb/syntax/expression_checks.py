"""Checks of an expression before it is parsed: its size, brackets and quotes; no grammar needed."""

import re

MAX_EXPRESSION_LENGTH = 65_536  # characters of one expression
MAX_EXPRESSION_NESTING = 50  # brackets in brackets
MAX_EXPRESSION_OPERATIONS = 100  # arithmetic signs in one expression


class ExpressionError(Exception):
    """The text is not an expression.

    `offset` is the first character that does not fit; `code` is the diagnostic code.
    """

    def __init__(self, offset: int, message: str, hint: str = "", code: str = "K107") -> None:
        super().__init__(message)
        self.offset, self.message, self.hint, self.code = offset, message, hint, code


def check_size(text: str) -> None:
    """Raise `ExpressionError` for a text with too many characters or arithmetic signs."""
    if len(text) > MAX_EXPRESSION_LENGTH:
        hint = "split it, or generate facts with rules"
        raise ExpressionError(0, f"longer than {MAX_EXPRESSION_LENGTH} characters", hint, "K007")
    for number, operation in enumerate(re.finditer(r"[-+*/\\]", without_texts(text)), 1):
        if number > MAX_EXPRESSION_OPERATIONS:
            hint = "compute it beforehand"
            raise ExpressionError(
                operation.start(), f"more than {MAX_EXPRESSION_OPERATIONS} operations", hint, "K007"
            )


def without_texts(text: str) -> str:
    """The same characters with every quoted text replaced by blanks."""
    return _TEXT.sub(lambda match: " " * len(match[0]), text)


_TEXT = re.compile(r'"(?:\\.|[^"\\\n])*"')
_CLOSING_BRACKETS = {"(": ")", "{": "}", "[": "]"}


def check_brackets(text: str) -> None:
    """Raise `ExpressionError` for a bracket or quote without its partner, and for brackets
    nested too deep.
    """
    open_at: list[tuple[str, int]] = []
    for bracket in re.finditer(r'[](){}["]', without_texts(text)):
        character, offset = bracket[0], bracket.start()
        if character == '"':
            raise ExpressionError(offset, "this text is never closed", 'end it with "', "K106")
        if character in _CLOSING_BRACKETS:
            open_at.append((_CLOSING_BRACKETS[character], offset))
        elif not open_at or open_at.pop()[0] != character:
            raise ExpressionError(
                offset, f"'{character}' closes no open bracket", _SPLIT_HINT, "K106"
            )
        if len(open_at) > MAX_EXPRESSION_NESTING:
            raise ExpressionError(
                offset, f"nested deeper than {MAX_EXPRESSION_NESTING} brackets", _DEPTH_HINT, "K007"
            )
    if open_at:
        raise ExpressionError(open_at[-1][1], "this bracket is never closed", _SPLIT_HINT, "K106")


_DEPTH_HINT = "no term needs so many"
_SPLIT_HINT = (
    "write the whole expression as one string: YAML splits [a(X, Y)] at its comma and cuts at ' #'"
)
