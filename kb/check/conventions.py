"""Finds declarations that are almost conventions of the engine: misspelt, or with other arguments.

Conventions about measurements are checked only in domains that measure. Two kinds of names are left out:
names that a domain gives to conventions, because the loader has checked them; and constants, because any
object may have a similar name.
"""

import difflib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from cellwright.kb.diagnostics import Diagnostic, Source
from cellwright.kb.model.conventions import CONVENTIONS, NUMBERS, Convention, Sort
from cellwright.kb.model.domain import Domain

ALIKE = 0.8  # ratio of difflib from which two names are alike
FITTING = 3  # a domain measures if it has this many conventions about measurements, even without the type


@dataclass(frozen=True, slots=True)
class Declared:
    """A name that a domain declares."""

    sort: str
    name: str
    arguments: tuple[str, ...]
    where: Source


def read_by_engine(domain: Domain) -> set[str]:
    """The names of the declarations that the engine reads or writes."""
    declared, words = list(_declared(domain)), domain.conventions
    named = ((each, getattr(words, each.role)) for each in CONVENTIONS.values())
    return {name for convention, name in named if any(_fits(convention, each, name) for each in declared)}


def near_misses(domain: Domain) -> list[Diagnostic]:
    """A warning for each declaration that the engine would read after a small change."""
    declared = list(_declared(domain))
    words = domain.conventions
    known = {getattr(words, role) for role in CONVENTIONS}
    others = [each for each in declared if each.name not in known]
    fitting = [
        c for c in CONVENTIONS.values() if any(_fits(c, each, getattr(words, c.role)) for each in declared)
    ]
    found: list[Diagnostic] = []
    for convention in CONVENTIONS.values():
        if convention.role in domain.renamed or convention.sort is Sort.CONSTANT:
            continue
        same = [each for each in declared if each.name == convention.role and _one_table(convention, each)]
        if same:
            found += _otherwise(convention, same[0], fitting)
        elif convention.is_about_time or _measures(fitting):
            found += _misspelt(convention, others)
    return found


def _declared(domain: Domain) -> Iterator[Declared]:
    for type_ in domain.types.values():
        yield Declared(Sort.TYPE.value, type_.name, (), type_.where)
    for function in domain.functions.values():
        yield Declared(Sort.FUNCTION.value, function.name, function.arguments, function.where)
    for each in domain.predicates.values():
        yield Declared(each.kind.value, each.name, each.arguments, each.where)


def _fits(convention: Convention, declared: Declared, name: str) -> bool:
    return declared.name == name and convention.deviation(declared.sort, declared.arguments) is None


def _one_table(convention: Convention, declared: Declared) -> bool:
    """Whether both are predicates, both types, or both functions."""
    others = {Sort.TYPE.value, Sort.FUNCTION.value}
    return convention.sort.value == declared.sort or not {convention.sort.value, declared.sort} & others


def _measures(fitting: Sequence[Convention]) -> bool:
    about = [each for each in fitting if not each.is_about_time]
    return any(each.sort is Sort.TYPE for each in about) or len(about) >= FITTING


def _otherwise(
    convention: Convention, declared: Declared, fitting: Sequence[Convention]
) -> Iterator[Diagnostic]:
    """A warning about a declaration with the name of a convention that the engine does not read."""
    deviation = convention.deviation(declared.sort, declared.arguments)
    if deviation is not None and _is_meant(convention, declared, fitting):
        message = f"the engine does not read this '{declared.name}': it {deviation[1]}"
        hint = f"declare it as {convention.written()}: {convention.meaning}; or give it another name"
        yield Diagnostic(declared.where, "K311", message, hint, warning=True)


def _is_meant(convention: Convention, declared: Declared, fitting: Sequence[Convention]) -> bool:
    """Whether a declaration that differs from the convention of its name is probably meant as one."""
    if declared.sort != convention.sort.value and len(declared.arguments) != len(convention.arguments):
        return False
    if convention.is_about_time:
        return {*declared.arguments} & {*NUMBERS} != set() or any(each.is_about_time for each in fitting)
    return _measures(fitting)


def _misspelt(convention: Convention, others: Sequence[Declared]) -> Iterator[Diagnostic]:
    """A warning about a declaration that would be the convention if it had its name."""
    fitting = {each.name: each for each in others if _fits(convention, each, each.name)}
    for name in difflib.get_close_matches(convention.role, sorted(fitting), n=1, cutoff=ALIKE):
        message = f"'{name}' is almost '{convention.role}', which the engine knows ({convention.meaning})"
        hint = f"write {convention.written()}, or `conventions: {{{convention.role}: {name}}}`"
        yield Diagnostic(fitting[name].where, "K311", message, hint, warning=True)
