"""Many questions about one program: whether it has a stable model in which certain atoms are true."""

from collections.abc import Iterable

import clingo

from cellwright.kb.asp import AspError, Messages
from cellwright.kb.asp.bounded import run_bounded


class Questions:
    """A grounded program with atoms `a(number)`. Raises `AspError`, and what `cellwright.kb.asp.bounded` raises where grounding takes too long."""

    def __init__(self, text: str) -> None:
        messages = Messages()
        self._control = clingo.Control(
            ["--warn=none", "--configuration=tweety"], logger=messages, message_limit=50
        )
        try:
            self._control.add("base", [], text)
            run_bounded(lambda: self._control.ground([("base", [])]))
        except RuntimeError as error:
            raise AspError(messages.heard or [(0, 0, str(error))]) from None

    def allow(self, numbers: Iterable[int]) -> bool:
        """Whether some stable model has all of these atoms."""
        wanted = [(clingo.Function("a", [clingo.Number(each)]), True) for each in numbers]
        return bool(self._control.solve(assumptions=wanted).satisfiable)
