"""Searches for stable models: all, the optimal ones, those under assumptions, and in many shots."""

import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import clingo

from cellwright.kb.asp import AspError, Messages, term_of_symbol
from cellwright.kb.asp.bounded_grounding import run_bounded
from cellwright.kb.terms import Function, Number


@dataclass(frozen=True, slots=True)
class ShownModel:
    """What a stable model shows: terms of one name, sorted, and the texts of all others, which
    nobody reads.
    """

    terms: tuple[Function, ...]
    others: frozenset[str]


def enumerate_models(text: str, shown: str, read: str, limit: int) -> Iterator[ShownModel]:
    """The arguments of the unary predicate `shown` in each stable model; those named `read` as
    terms.

    Each set comes once; at most `limit` sets. clingo searches with one thread and a fixed
    configuration, so the order repeats. Raises `AspError`.
    """
    messages = Messages()
    options = ["--warn=none", f"--models={limit}", "--project=project", "--configuration=tweety"]
    control = clingo.Control(options, logger=messages, message_limit=50)
    try:
        control.add("base", [], f"{text}\n#show {shown}/1.\n#project {shown}/1.")
        run_bounded(lambda: control.ground([("base", [])]))
    except RuntimeError as error:
        raise AspError(messages.heard or [(0, 0, str(error))]) from None
    with control.solve(yield_=True) as handle:
        for model in handle:
            arguments = [symbol.arguments[0] for symbol in model.symbols(shown=True)]
            texts = list(map(str, arguments))
            own = [text.startswith(f"{read}(") for text in texts]
            terms = [term_of_symbol(argument) for argument in itertools.compress(arguments, own)]
            atoms = sorted((term for term in terms if isinstance(term, Function)), key=str)
            yield ShownModel(
                tuple(atoms),
                frozenset(t for t, is_read in zip(texts, own, strict=True) if not is_read),
            )


OPTIMUM_POLL_S = 0.05  # seconds between two checks whether to stop


def best_models(
    text: str,
    shown: str,
    limit: int,
    options: tuple[str, ...] = (),
    interrupted: Callable[[], bool] = lambda: False,
) -> Iterator[tuple[int, tuple[Function, ...]]]:
    """The cost and the arguments of the unary predicate `shown` in optimal models, without those
    that contain an earlier one.

    If each atom has a cost of its own, these are the minimal sets, the cheapest first. At most
    `limit` models are given. When `interrupted` returns True, no more models come after the first
    one. clingo searches with one thread, so that the order repeats. Raises `AspError`.
    """
    messages = Messages()
    control = clingo.Control(["--warn=none", *options], logger=messages, message_limit=50)
    try:
        control.add("base", [], f"{text}\n#show {shown}/1.")
        run_bounded(lambda: control.ground([("base", [])]))
    except RuntimeError as error:
        raise AspError(messages.heard or [(0, 0, str(error))]) from None
    for number in range(limit):
        best = _search_optimum(control, interrupted if number else lambda: False)
        if best is None:
            return
        yield best
        part = f"above_{number}"
        body = ", ".join(f"{shown}({atom})" for atom in best[1])
        control.add(part, [], f":- {body}." if body else ":- .")
        control.ground([(part, [])])


def _search_optimum(
    control: clingo.Control, interrupted: Callable[[], bool]
) -> tuple[int, tuple[Function, ...]] | None:
    """The optimal model, which is the last one of a search; None if there is no model or no
    time.
    """
    best = None
    with control.solve(yield_=True, async_=True) as models:
        while True:
            models.resume()
            # clingo holds no lock here, so that Python hears Ctrl-C
            while not models.wait(OPTIMUM_POLL_S):
                if interrupted():
                    models.cancel()
                    return None
            model = models.model()
            if model is None:
                return best
            atoms = (term_of_symbol(symbol.arguments[0]) for symbol in model.symbols(shown=True))
            chosen = tuple(sorted((atom for atom in atoms if isinstance(atom, Function)), key=str))
            best = (sum(model.cost), chosen)


class Questions:
    """A grounded program with atoms `a(number)`.

    Raises `AspError`, and what `cellwright.kb.asp.bounded_grounding` raises where grounding takes
    too long.
    """

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
        assumptions = [(clingo.Function("a", [clingo.Number(number)]), True) for number in numbers]
        return bool(self._control.solve(assumptions=assumptions).satisfiable)


Shown = frozenset[tuple[int, ...]] | bool | None
"""The arguments of the shown atoms of a model; False if there is no model; None if this is
unknown.
"""

SOLVE_POLL_S = 0.05  # seconds between two checks whether to stop


class MultiShotSolver:
    """A program in named parts.

    clingo searches with one thread and a fixed configuration, so that answers repeat.
    """

    def __init__(
        self, parts: Mapping[str, tuple[Sequence[str], str]], options: Sequence[str] = ()
    ) -> None:
        self._messages = Messages()
        self._control = clingo.Control(
            ["--warn=none", *options], logger=self._messages, message_limit=50
        )
        self.conflicts = 0
        try:
            for name, (parameters, text) in parts.items():
                self._control.add(name, list(parameters), text)
        except RuntimeError as error:
            raise AspError(self._messages.heard or [(0, 0, str(error))]) from None

    def ground(self, parts: Iterable[tuple[str, Sequence[int]]]) -> None:
        """Grounds parts with numbers for their parameters. Raises `AspError`."""
        try:
            parts_to_ground = [
                (name, [clingo.Number(n) for n in numbers]) for name, numbers in parts
            ]
            run_bounded(lambda: self._control.ground(parts_to_ground))
        except RuntimeError as error:
            raise AspError(self._messages.heard or [(0, 0, str(error))]) from None

    def solve(
        self, assumed: Iterable[Function], conflicts: int, interrupted: Callable[[], bool]
    ) -> Shown:
        """The arguments of the shown atoms of a model; False if there is none; None if the limit
        came first.

        Shown atoms have numbers as arguments. External atoms are false, except those that are
        `assumed`.
        """
        self._control.configuration.solve.solve_limit = str(max(conflicts, 1))  # type: ignore[union-attr]
        names = [_number_symbol(atom) for atom in assumed]
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
            while not handle.wait(SOLVE_POLL_S):
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


def _number_symbol(atom: Function) -> clingo.Symbol:
    return clingo.Function(
        atom.name, [clingo.Number(a.value) for a in atom.arguments if isinstance(a, Number)]
    )
