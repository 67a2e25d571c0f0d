"""Enumerates stable models of small programs, projected to one predicate."""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import clingo

from cellwright.kb.asp import AspError, Messages, term
from cellwright.kb.asp.bounded import run_bounded
from cellwright.kb.terms import Function


@dataclass(frozen=True, slots=True)
class Model:
    """What a stable model shows: terms of one name, sorted, and the texts of all others, which nobody reads."""

    terms: tuple[Function, ...]
    others: frozenset[str]


def models(text: str, shown: str, read: str, limit: int) -> Iterator[Model]:
    """The arguments of the unary predicate `shown` in each stable model; those named `read` as terms.

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
            arguments = [symbol.arguments[0] for symbol in model.symbols(shown=True)]
            texts = list(map(str, arguments))
            own = [text.startswith(f"{read}(") for text in texts]
            terms = [term(each) for each in itertools.compress(arguments, own)]
            kept = sorted((each for each in terms if isinstance(each, Function)), key=str)
            yield Model(
                tuple(kept), frozenset(t for t, is_read in zip(texts, own, strict=True) if not is_read)
            )
