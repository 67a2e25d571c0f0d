"""Declarations that are almost what the engine reads by convention: misspelt, or with other arguments.

What is about measurements is looked at in domains that measure. Left out are names that a domain gives itself, which
the loader has checked, and constants, of which objects of any kind might have nearly the name.
"""

import difflib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from kb.diagnostics import Diagnostic, Source
from kb.model.conventions import CONVENTIONS, NUMBERS, Convention, Sort
from kb.model.domain import Domain

ALIKE = 0.8  # of two names: difflib's ratio
FITTING = 3  # so many conventions about measurements make a domain one that measures, without the type


@dataclass(frozen=True, slots=True)
class Declared:
    """A name that a domain declares."""

    sort: str
    name: str
    arguments: tuple[str, ...]
    where: Source


def read_by_engine(domain: Domain) -> set[str]:
    """The names of what a domain declares as the engine reads or writes it."""
    declared, words = list(_declared(domain)), domain.conventions
    named = ((each, getattr(words, each.role)) for each in CONVENTIONS.values())
    return {name for convention, name in named if any(_fits(convention, each, name) for each in declared)}


def near_misses(domain: Domain) -> list[Diagnostic]:
    """A warning for each declaration that the engine would read if it were written a little otherwise."""
    declared = list(_declared(domain))
    words = domain.conventions
    known = {getattr(words, role) for role in CONVENTIONS}
    others = [each for each in declared if each.name not in known]
    fitting = [
        c for c in CONVENTIONS.values() if any(_fits(c, each, getattr(words, c.role)) for each in declared)
    ]
    found: list[Diagnostic] = []
    for convention in CONVENTIONS.values():
        if convention.role in domain.renamed or convention in fitting or convention.sort is Sort.CONSTANT:
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
    """Whether both are predicates, or both the same other thing."""
    others = {Sort.TYPE.value, Sort.FUNCTION.value}
    return convention.sort.value == declared.sort or not {convention.sort.value, declared.sort} & others


def _measures(fitting: Sequence[Convention]) -> bool:
    about = [each for each in fitting if not each.is_about_time]
    return any(each.sort is Sort.TYPE for each in about) or len(about) >= FITTING


def _otherwise(
    convention: Convention, declared: Declared, fitting: Sequence[Convention]
) -> Iterator[Diagnostic]:
    """The name of a convention, declared so that the engine does not read it."""
    deviation = convention.deviation(declared.sort, declared.arguments)
    if deviation is not None and _is_meant(convention, declared, fitting):
        message = f"the engine does not read this '{declared.name}': it {deviation[1]}"
        hint = f"declare it as {convention.written()}: {convention.meaning}; or give it another name"
        yield Diagnostic(declared.where, "K311", message, hint, warning=True)


def _is_meant(convention: Convention, declared: Declared, fitting: Sequence[Convention]) -> bool:
    """Whether a declaration of another shape is likely to be meant as the convention of its name."""
    if declared.sort != convention.sort.value and len(declared.arguments) != len(convention.arguments):
        return False
    if convention.is_about_time:
        return {*declared.arguments} & {*NUMBERS} != set() or any(each.is_about_time for each in fitting)
    return _measures(fitting)


def _misspelt(convention: Convention, others: Sequence[Declared]) -> Iterator[Diagnostic]:
    """Something that would be the convention if it were called so."""
    fitting = {each.name: each for each in others if _fits(convention, each, each.name)}
    for name in difflib.get_close_matches(convention.role, sorted(fitting), n=1, cutoff=ALIKE):
        message = f"'{name}' is almost '{convention.role}', which the engine knows ({convention.meaning})"
        hint = f"write {convention.written()}, or `conventions: {{{convention.role}: {name}}}`"
        yield Diagnostic(fitting[name].where, "K311", message, hint, warning=True)
