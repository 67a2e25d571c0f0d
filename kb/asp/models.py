"""Enumerates stable models of small programs, projected to one predicate."""

from collections.abc import Iterator

import clingo

from kb.asp import AspError, Messages, term
from kb.asp.bounded import run_bounded
from kb.terms import Function


def models(text: str, shown: str, limit: int) -> Iterator[tuple[Function, ...]]:
    """The arguments of the unary predicate `shown` in each stable model.

    Each set comes once; at most `limit` sets. clingo searches with one thread and a fixed configuration, so
    the order repeats. Raises `AspError`.
    """
    messages = Messages()
    options = ["--warn=none", f"--models={limit}", "--project=project", "--configuration=tweety"]
    control = clingo.Control(options, logger=messages, message_limit=50)
    try:
        control.add("base", [], f"{text}\n#show {shown}/1.\n#project {shown}/1.")
        run_bounded(lambda: control.ground([("base", [])]))
    except RuntimeError as error:
        raise AspError(messages.heard or [(0, 0, str(error))]) from None
    with control.solve(yield_=True) as found:
        for model in found:
            atoms = (term(symbol.arguments[0]) for symbol in model.symbols(shown=True))
            yield tuple(sorted((atom for atom in atoms if isinstance(atom, Function)), key=str))
