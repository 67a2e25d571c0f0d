"""Optimal stable models of programs with `#minimize`, one after the other. None contains an earlier one."""

from collections.abc import Callable, Iterator

import clingo

from cellwright.kb.asp import AspError, Messages, term
from cellwright.kb.asp.bounded import run_bounded
from cellwright.kb.terms import Function

PAUSE = 0.05  # seconds between two checks whether to stop


def best_models(
    text: str,
    shown: str,
    limit: int,
    options: tuple[str, ...] = (),
    interrupted: Callable[[], bool] = lambda: False,
) -> Iterator[tuple[int, tuple[Function, ...]]]:
    """The cost and the arguments of the unary predicate `shown` in optimal models, without those that contain
    an earlier one.

    If each atom has a cost of its own, these are the minimal sets, the cheapest first. At most `limit` models
    are given. When `interrupted` returns True, no more models come after the first one. clingo searches with
    one thread, so that the order repeats. Raises `AspError`.
    """
    messages = Messages()
    control = clingo.Control(["--warn=none", *options], logger=messages, message_limit=50)
    try:
        control.add("base", [], f"{text}\n#show {shown}/1.")
        run_bounded(lambda: control.ground([("base", [])]))
    except RuntimeError as error:
        raise AspError(messages.heard or [(0, 0, str(error))]) from None
    for number in range(limit):
        found = _optimum(control, interrupted if number else lambda: False)
        if found is None:
            return
        yield found
        part = f"above_{number}"
        body = ", ".join(f"{shown}({atom})" for atom in found[1])
        control.add(part, [], f":- {body}." if body else ":- .")
        control.ground([(part, [])])


def _optimum(
    control: clingo.Control, interrupted: Callable[[], bool]
) -> tuple[int, tuple[Function, ...]] | None:
    """The optimal model, which is the last one of a search; None if there is no model or no time."""
    best = None
    with control.solve(yield_=True, async_=True) as models:
        while True:
            models.resume()
            while not models.wait(PAUSE):  # clingo holds no lock here, so that Python hears Ctrl-C
                if interrupted():
                    models.cancel()
                    return None
            model = models.model()
            if model is None:
                return best
            atoms = (term(symbol.arguments[0]) for symbol in model.symbols(shown=True))
            chosen = tuple(sorted((atom for atom in atoms if isinstance(atom, Function)), key=str))
            best = (sum(model.cost), chosen)
