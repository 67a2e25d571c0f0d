"""Multi-shot solving: a program grows part by part, and is solved within a limit of conflicts."""

from collections.abc import Callable, Iterable, Mapping, Sequence

import clingo

from cellwright.kb.asp import AspError, Messages
from cellwright.kb.asp.bounded import run_bounded
from cellwright.kb.terms import Function, Number

Shown = frozenset[tuple[int, ...]] | bool | None
"""The arguments of the shown atoms of a model; False if there is no model; None if this is unknown."""

PAUSE = 0.05  # seconds between two checks whether to stop


class Solver:
    """A program in named parts.

    clingo searches with one thread and a fixed configuration, so that answers repeat.
    """

    def __init__(self, parts: Mapping[str, tuple[Sequence[str], str]], options: Sequence[str] = ()) -> None:
        self._messages = Messages()
        self._control = clingo.Control(["--warn=none", *options], logger=self._messages, message_limit=50)
        self.conflicts = 0
        try:
            for name, (parameters, text) in parts.items():
                self._control.add(name, list(parameters), text)
        except RuntimeError as error:
            raise AspError(self._messages.heard or [(0, 0, str(error))]) from None

    def ground(self, parts: Iterable[tuple[str, Sequence[int]]]) -> None:
        """Grounds parts with numbers for their parameters. Raises `AspError`."""
        try:
            wanted = [(name, [clingo.Number(n) for n in numbers]) for name, numbers in parts]
            run_bounded(lambda: self._control.ground(wanted))
        except RuntimeError as error:
            raise AspError(self._messages.heard or [(0, 0, str(error))]) from None

    def solve(self, assumed: Iterable[Function], conflicts: int, interrupted: Callable[[], bool]) -> Shown:
        """The arguments of the shown atoms of a model; False if there is none; None if the limit came first.

        Shown atoms have numbers as arguments. External atoms are false, except those that are `assumed`.
        """
        self._control.configuration.solve.solve_limit = str(max(conflicts, 1))  # type: ignore[union-attr]
        names = [_symbol(each) for each in assumed]
        for name in names:
            self._control.assign_external(name, True)
        try:
            return self._answer(interrupted)
        finally:
            for name in names:
                self._control.assign_external(name, False)

    def _answer(self, interrupted: Callable[[], bool]) -> Shown:
        shown: frozenset[tuple[int, ...]] | None = None
        with self._control.solve(yield_=True, async_=True) as handle:
            handle.resume()
            while not handle.wait(PAUSE):
                if interrupted():
                    handle.cancel()
                    return None
            model = handle.model()
            if model is not None:
                symbols = model.symbols(shown=True)
                shown = frozenset(tuple(a.number for a in symbol.arguments) for symbol in symbols)
            result = None if model is not None else handle.get()
        self.conflicts += int(self._control.statistics["solving"]["solvers"]["conflicts"])
        if shown is not None:
            return shown
        return False if result is not None and result.unsatisfiable else None


def _symbol(atom: Function) -> clingo.Symbol:
    return clingo.Function(
        atom.name, [clingo.Number(a.value) for a in atom.arguments if isinstance(a, Number)]
    )
