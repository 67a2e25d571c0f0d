"""Reports variables without a value (an error: numbers, times and texts cannot be enumerated), and warns of variables used only once.

See Meaning 2 in the language reference. What binds a variable is said in `cellwright.kb.model.bindings`.
"""

from collections import Counter
from collections.abc import Collection, Iterable, Iterator
from typing import Any

from cellwright.kb.diagnostics import nearest
from cellwright.kb.loader.names import Names
from cellwright.kb.loader.reader import Expression
from cellwright.kb.model.bindings import free_variables
from cellwright.kb.model.conditions import (
    Aggregate,
    Comparison,
    Condition,
    Literal,
    conditions,
    part_variables,
)
from cellwright.kb.terms import ANYTHING, Function, Operation, Term, Variable, variables


def refuse_unbound(
    wanted: Iterable[Variable], bound: Collection[Variable], expression: Expression, names: Names, hint: str
) -> None:
    """Report every wanted variable that is not bound."""
    for variable in dict.fromkeys(wanted):
        if variable != ANYTHING and variable not in bound:
            message = f"nothing binds the variable {variable}"
            near = nearest(str(variable), [str(each) for each in bound])
            names.findings.add(expression.place(variable), "K105", message, near or hint)


def occurrences(values: Iterable[object]) -> Counter[Variable]:
    """The number of occurrences of each variable in terms, atoms, conditions and nested tuples of them; `_` is not counted."""
    found: Counter[Variable] = Counter()
    for value in values:
        found.update(variable for variable in _standing(value) if variable != ANYTHING)
    return found


def _standing(value: object) -> Iterator[Variable]:
    match value:
        case tuple():
            for part in value:
                yield from _standing(part)
        case Variable() | Function() | Operation():
            yield from variables(value)
        case Literal() | Comparison():
            yield from _of_part(value)
        case Aggregate(standing=standing):
            yield from standing
        case None:
            return
        case _:
            yield from (v for part in conditions(value) for v in _of_part(part))  # type: ignore[arg-type]


def _of_part(part: Condition) -> Iterator[Variable]:
    match part:
        case Literal() | Comparison():
            yield from part_variables(part)
        case Aggregate():
            yield from _standing(part)
        case _:
            return


def warn_singletons(
    suspects: Iterable[Variable],
    counted: Counter[Variable],
    expression: Expression,
    names: Names,
    advice: str = "write '_' or '_{}' if anything will do",
) -> None:
    """Warn of the suspects that occur only once. A name that begins with `_` shows that this is intended."""
    for variable in dict.fromkeys(suspects):
        if counted[variable] == 1 and not variable.name.startswith("_"):
            others = [each.name for each in counted if each != variable]
            hint = nearest(variable.name, others) or advice.format(variable)
            message = f"the variable {variable} occurs only once"
            names.findings.add(expression.place(variable), "K110", message, hint, warning=True)


def body_variables(body: Iterable[Condition]) -> tuple[Variable, ...]:
    """The free variables of a body, each once."""
    return tuple(dict.fromkeys(variable for part in body for variable in free_variables(part)))


def free_in(value: Any) -> Iterable[Variable]:
    """The free variables of a tuple of atoms, terms or conditions."""
    for part in value if isinstance(value, tuple) else (value,):
        yield from variables(part) if isinstance(part, Term) else free_variables(part)


def refuse_anything(expression: Expression, name: str, names: Names) -> None:
    """Report `_` where it cannot be used, because it has no value."""
    if ANYTHING in free_in(expression.value):
        hint = "name a variable that something binds"
        names.findings.add(expression.place(ANYTHING), "K105", f"'_' cannot be used in `{name}`", hint)
