"""Finds what a domain probably forgets: a rule for a name that is misspelt, a fact that is taken away and never given back."""

import difflib
from collections.abc import Collection, Iterator

from cellwright.kb.diagnostics import Diagnostic
from cellwright.kb.model.conditions import literals
from cellwright.kb.model.domain import DeductiveOperator, Domain, Kind

ALIKE = 0.75  # ratio of difflib from which two names are alike


def misspelt_heads(domain: Domain, read: Collection[str]) -> Iterator[Diagnostic]:
    """Warnings about rules for a name that nothing declares or reads, but that is almost a declared one. `read` are names in use."""
    used = {*read, *(use.predicate[0] for each in domain.asp for use in each.uses)}
    told: set[str] = set()
    for each in domain.asp:
        if each.defines is None:
            continue
        name, count = each.defines
        if name in told or name in used or name in domain.predicates or name in domain.types:
            continue
        defined = (Kind.STATIC, Kind.DERIVED)
        alike = [
            p.name for p in domain.predicates.values() if p.kind in defined and len(p.arguments) == count
        ]
        if near := difflib.get_close_matches(name, alike, n=1, cutoff=ALIKE):
            told.add(name)
            message = f"nothing declares or reads '{name}', which this rule defines"
            yield Diagnostic(each.where, "K312", message, f"did you mean '{near[0]}'?", warning=True)


def never_given_back(domain: Domain) -> Iterator[Diagnostic]:
    """Warnings about a fluent that another one denies, such as `free(Place)`, and that nothing makes true when that one ends."""
    needed = {each.atom.name for o in domain.operators for each in literals(o.precondition) if each.positive}
    made = {effect.atom.name for o in domain.operators for effect in o.effects if effect.adds}
    made |= {each.atom.name for d in domain.deductive_operators for each in d.consequences if each.implied}
    told: set[str] = set()
    for rule in (
        each for each in domain.deductive_operators if each.trigger.positive and _ends(domain, each)
    ):
        for each in rule.consequences:
            name = each.atom.name
            if each.implied or name in made or name not in needed or name in told:
                continue
            told.add(name)
            message = (
                f"{rule.trigger.atom} denies {each.atom}, and nothing makes '{name}' true again when it ends"
            )
            hint = f"add `when: not {rule.trigger.atom}` with `implies: {each.atom}`"
            yield Diagnostic(rule.where, "K315", message, hint, warning=True)


def _ends(domain: Domain, rule: DeductiveOperator) -> bool:
    """Whether the trigger of a deductive operator can become false."""
    name = rule.trigger.atom.name
    deleted = {effect.atom.name for o in domain.operators for effect in o.effects if not effect.adds}
    denied = {c.atom.name for d in domain.deductive_operators for c in d.consequences if not c.implied}
    return name in deleted | denied
