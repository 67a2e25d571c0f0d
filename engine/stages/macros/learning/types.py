"""Separates unary constraints, the types of variables, from n-ary constraints."""

from collections.abc import Iterable, Iterator

from cellwright.kb.model.conditions import Body, BodyPart, Literal, Parameter, part_variables, substitute_part
from cellwright.kb.model.domain import OBJECT, Domain
from cellwright.kb.terms import Function, Term, Variable


def unary(parts: Iterable[BodyPart], domain: Domain) -> tuple[Body, tuple[Parameter, ...]]:
    """The n-ary constraints among the conjuncts, and the narrowest types of each variable."""
    rest: dict[BodyPart, None] = {}
    types: dict[Variable, list[str]] = {}
    for part in parts:
        if isinstance(part, Literal) and part.positive and _is_type(part, domain):
            for found in _typed(part.atom.arguments[0], part.atom.name, domain):
                if isinstance(found, Literal):
                    rest[found] = None
                else:
                    _narrow(types.setdefault(found.variable, []), found.type, domain)
        else:
            rest[part] = None
    return tuple(rest), tuple(Parameter(v, name) for v, names in types.items() for name in names)


def _is_type(part: Literal, domain: Domain) -> bool:
    return len(part.atom.arguments) == 1 and part.atom.name in domain.types


def _narrow(names: list[str], name: str, domain: Domain) -> None:
    if any(domain.is_subtype(other, name) for other in names):
        return
    names[:] = [*(other for other in names if not domain.is_subtype(name, other)), name]


def _typed(term: Term, type_: str, domain: Domain) -> Iterator[Parameter | Literal]:
    """The tests that remain for a term of a type.

    A compound term has the type if its arguments have theirs. A known object needs no test.
    """
    if isinstance(term, Variable):
        yield Parameter(term, type_)
        return
    if isinstance(term, Function) and not term.arguments and _is_known(term, type_, domain):
        return
    signature = domain.functions.get(term.name) if isinstance(term, Function) and term.arguments else None
    if signature is None or not domain.is_subtype(signature.result, type_) or not isinstance(term, Function):
        yield Literal(Function(type_, (term,)))
        return
    for argument, inner in zip(term.arguments, signature.arguments, strict=True):
        if inner in domain.types and inner != OBJECT:
            yield from _typed(argument, inner, domain)


def _is_known(term: Function, type_: str, domain: Domain) -> bool:
    own = domain.objects.get(term.name)
    if own is not None:
        return domain.is_subtype(own, type_)
    return any(
        term.name in each.constants and domain.is_subtype(each.name, type_) for each in domain.types.values()
    )


def without_copies(body: Body, outer: set[Variable]) -> Body:
    """The body without copies of conjuncts that are equal except for the names of existential variables.

    Conjuncts that share such a variable belong together, so they are compared and removed together.
    """
    kept: list[BodyPart] = []
    seen: set[str] = set()
    for group in _groups(body, outer):
        names: dict[Variable, Term] = {}
        for part in group:
            for variable in part_variables(part):
                if variable not in outer:
                    names.setdefault(variable, Variable(f"_{len(names)}"))
        key = ", ".join(str(substitute_part(part, names)) for part in group)
        if key not in seen:
            seen.add(key)
            kept += group
    return tuple(kept)


def _groups(body: Body, outer: set[Variable]) -> list[list[BodyPart]]:
    groups: list[tuple[set[Variable], list[BodyPart]]] = []
    for part in body:
        own = set(part_variables(part)) - outer
        joined = [group for group in groups if own & group[0]]
        parts = [each for group in joined for each in group[1]]
        groups = [group for group in groups if group not in joined]
        groups.append((own.union(*(group[0] for group in joined)), [*parts, part]))
    return [parts for _, parts in groups]
