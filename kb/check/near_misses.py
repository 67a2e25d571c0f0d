"""Probable slips of a domain: names almost those of conventions, heads that nothing reads.

Conventions about measurements are checked only in domains that measure. Two kinds of names are left
out: names that a domain gives to conventions, because the loader has checked them; and constants,
because any object may have a similar name.
"""

import difflib
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass

from cellwright.kb.diagnostics import Diagnostic, Source
from cellwright.kb.model.conditions import literals_in
from cellwright.kb.model.domain_model import DeductiveOperator, Domain, Kind
from cellwright.kb.model.name_conventions import CONVENTION_BY_NAME, NUMBER_SORTS, Convention, Sort

CONVENTION_LIKENESS = 0.8  # ratio of difflib from which two names are alike
MIN_FITTING_CONVENTIONS = (
    3  # a domain measures if it has this many conventions about measurements, even without the type
)


@dataclass(frozen=True, slots=True)
class DeclaredName:
    """A name that a domain declares."""

    sort: str
    name: str
    arguments: tuple[str, ...]
    where: Source


def read_by_engine(domain: Domain) -> set[str]:
    """The names of the declarations that the engine reads or writes."""
    declared, words = list(_declared_names(domain)), domain.conventions
    named = (
        (convention, getattr(words, convention.role)) for convention in CONVENTION_BY_NAME.values()
    )
    return {
        name
        for convention, name in named
        if any(_fits_convention(convention, declaration, name) for declaration in declared)
    }


def near_misses(domain: Domain) -> list[Diagnostic]:
    """A warning for each declaration that the engine would read after a small change."""
    declared = list(_declared_names(domain))
    words = domain.conventions
    known = {getattr(words, role) for role in CONVENTION_BY_NAME}
    unknown = [declaration for declaration in declared if declaration.name not in known]
    fitting = [
        c
        for c in CONVENTION_BY_NAME.values()
        if any(_fits_convention(c, declaration, getattr(words, c.role)) for declaration in declared)
    ]
    warnings: list[Diagnostic] = []
    for convention in CONVENTION_BY_NAME.values():
        if convention.role in domain.renamed or convention.sort is Sort.CONSTANT:
            continue
        same = [
            declaration
            for declaration in declared
            if declaration.name == convention.role and _one_table(convention, declaration)
        ]
        if same:
            warnings += _warn_of_deviation(convention, same[0], fitting)
        elif convention.is_about_time or _is_measuring(fitting):
            warnings += _warn_of_misspelling(convention, unknown)
    return warnings


def _declared_names(domain: Domain) -> Iterator[DeclaredName]:
    for type_ in domain.types.values():
        yield DeclaredName(Sort.TYPE.value, type_.name, (), type_.where)
    for function in domain.functions.values():
        yield DeclaredName(Sort.FUNCTION.value, function.name, function.arguments, function.where)
    for predicate in domain.predicates.values():
        yield DeclaredName(
            predicate.kind.value, predicate.name, predicate.arguments, predicate.where
        )


def _fits_convention(convention: Convention, declared: DeclaredName, name: str) -> bool:
    return declared.name == name and convention.deviation(declared.sort, declared.arguments) is None


def _one_table(convention: Convention, declared: DeclaredName) -> bool:
    """Whether both are predicates, both types, or both functions."""
    table_sorts = {Sort.TYPE.value, Sort.FUNCTION.value}
    return (
        convention.sort.value == declared.sort
        or not {convention.sort.value, declared.sort} & table_sorts
    )


def _is_measuring(fitting: Sequence[Convention]) -> bool:
    about = [convention for convention in fitting if not convention.is_about_time]
    return (
        any(convention.sort is Sort.TYPE for convention in about)
        or len(about) >= MIN_FITTING_CONVENTIONS
    )


def _warn_of_deviation(
    convention: Convention, declared: DeclaredName, fitting: Sequence[Convention]
) -> Iterator[Diagnostic]:
    """A warning about a declaration with the name of a convention that the engine does not read."""
    deviation = convention.deviation(declared.sort, declared.arguments)
    if deviation is not None and _is_meant(convention, declared, fitting):
        message = f"the engine does not read this '{declared.name}': it {deviation[1]}"
        hint = (
            f"declare it as {convention.written()}: {convention.meaning}; or give it another name"
        )
        yield Diagnostic(declared.where, "K311", message, hint, warning=True)


def _is_meant(
    convention: Convention, declared: DeclaredName, fitting: Sequence[Convention]
) -> bool:
    """Whether a declaration that differs from the convention of its name is probably meant as
    one.
    """
    if declared.sort != convention.sort.value and len(declared.arguments) != len(
        convention.arguments
    ):
        return False
    if convention.is_about_time:
        return {*declared.arguments} & {*NUMBER_SORTS} != set() or any(
            fitting_convention.is_about_time for fitting_convention in fitting
        )
    return _is_measuring(fitting)


def _warn_of_misspelling(
    convention: Convention, others: Sequence[DeclaredName]
) -> Iterator[Diagnostic]:
    """A warning about a declaration that would be the convention if it had its name."""
    fitting = {
        declaration.name: declaration
        for declaration in others
        if _fits_convention(convention, declaration, declaration.name)
    }
    for name in difflib.get_close_matches(
        convention.role, sorted(fitting), n=1, cutoff=CONVENTION_LIKENESS
    ):
        message = (
            f"'{name}' is almost '{convention.role}', which the engine knows ({convention.meaning})"
        )
        hint = f"write {convention.written()}, or `conventions: {{{convention.role}: {name}}}`"
        yield Diagnostic(fitting[name].where, "K311", message, hint, warning=True)


NAME_LIKENESS = 0.75  # ratio of difflib from which two names are alike


def misspelt_heads(domain: Domain, read: Collection[str]) -> Iterator[Diagnostic]:
    """Warnings about rules for a name that nothing declares or reads, but that is almost a
    declared one. `read` are names in use.
    """
    used = {*read, *(use.predicate[0] for statement in domain.asp for use in statement.uses)}
    told_names: set[str] = set()
    for asp_statement in domain.asp:
        if asp_statement.defines is None:
            continue
        name, count = asp_statement.defines
        if name in told_names or name in used or name in domain.predicates or name in domain.types:
            continue
        defined = (Kind.STATIC, Kind.DERIVED)
        alike = [
            p.name
            for p in domain.predicates.values()
            if p.kind in defined and len(p.arguments) == count
        ]
        if near := difflib.get_close_matches(name, alike, n=1, cutoff=NAME_LIKENESS):
            told_names.add(name)
            message = f"nothing declares or reads '{name}', which this rule defines"
            yield Diagnostic(
                asp_statement.where, "K312", message, f"did you mean '{near[0]}'?", warning=True
            )


def never_given_back(domain: Domain) -> Iterator[Diagnostic]:
    """Warnings about a fluent that another one denies, such as `free(Place)`, and that nothing
    makes true when that one ends.
    """
    needed = {
        literal.atom.name
        for o in domain.operators
        for literal in literals_in(o.precondition)
        if literal.positive
    }
    added = {effect.atom.name for o in domain.operators for effect in o.effects if effect.adds}
    added |= {
        consequence.atom.name
        for d in domain.deductive_operators
        for consequence in d.consequences
        if consequence.implied
    }
    told_names: set[str] = set()
    for rule in (
        operator
        for operator in domain.deductive_operators
        if operator.trigger.positive and _can_end(domain, operator)
    ):
        for rule_consequence in rule.consequences:
            name = rule_consequence.atom.name
            if (
                rule_consequence.implied
                or name in added
                or name not in needed
                or name in told_names
            ):
                continue
            told_names.add(name)
            message = (
                f"{rule.trigger.atom} denies {rule_consequence.atom}, and nothing makes "
                f"'{name}' true again when it ends"
            )
            hint = f"add `when: not {rule.trigger.atom}` with `implies: {rule_consequence.atom}`"
            yield Diagnostic(rule.where, "K315", message, hint, warning=True)


def _can_end(domain: Domain, rule: DeductiveOperator) -> bool:
    """Whether the trigger of a deductive operator can become false."""
    name = rule.trigger.atom.name
    deleted = {
        effect.atom.name for o in domain.operators for effect in o.effects if not effect.adds
    }
    denied = {
        c.atom.name for d in domain.deductive_operators for c in d.consequences if not c.implied
    }
    return name in deleted | denied
