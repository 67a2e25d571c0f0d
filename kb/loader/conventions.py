"""The section `conventions` of a domain file: what the domain calls the names that the engine knows."""

from collections.abc import Mapping

from cellwright.kb.diagnostics import unknown_name
from cellwright.kb.loader.names import Names
from cellwright.kb.loader.reader import Reader
from cellwright.kb.loader.tree import Node
from cellwright.kb.model.conventions import CONVENTIONS, WITH_ARTICLE, Convention, Sort

PREDICATES = (Sort.STATIC, Sort.FLUENT)


def read_conventions(reader: Reader, names: Names) -> dict[str, str]:
    """The conventions that have another name here, with that name. What does not fit is noted."""
    given: dict[str, tuple[str, Node]] = {}
    for role, key, node in reader.entries("conventions"):
        if role in CONVENTIONS:
            given[role] = str(node.value), node
        else:
            names.findings.note(unknown_name("convention", role, CONVENTIONS, key.where))
    taken = {role: role for role in CONVENTIONS if role not in given}
    for role, (name, node) in given.items():
        if _is_declared(CONVENTIONS[role], name, node, names):
            _require_alone(CONVENTIONS[role], taken, node, names)
        taken[role] = name
    return {role: name for role, (name, _) in given.items()}


def _is_declared(convention: Convention, name: str, node: Node, names: Names) -> bool:
    """Whether the name is declared as what it should be; if not, that is noted."""
    sort, declared = convention.sort.value, _declared(convention.sort, names)
    if name not in declared:
        if name not in names.broken:
            word = "predicate" if convention.sort in PREDICATES else sort
            names.findings.note(unknown_name(word, name, declared, node.where))
        return False
    arguments: tuple[str, ...] = ()
    if convention.sort in PREDICATES:
        sort, arguments = names.predicates[name].kind.value, names.predicates[name].arguments
    elif convention.sort is Sort.FUNCTION:
        arguments = names.functions[name].arguments
    if (found := convention.deviation(sort, arguments)) is not None:
        code, said = found
        message = f"'{name}' cannot stand for '{convention.role}': it {said}"
        hint = (
            f"name {WITH_ARTICLE[convention.sort.value]} such as {convention.written()}: {convention.meaning}"
        )
        names.findings.add(node.where, code, message, hint)
    return found is None


def _declared(sort: Sort, names: Names) -> Mapping[str, object]:
    if sort in PREDICATES:
        return names.predicates
    tables: dict[Sort, Mapping[str, object]] = {
        Sort.TYPE: names.types,
        Sort.FUNCTION: names.functions,
        Sort.CONSTANT: names.objects,
    }
    return tables[sort]


def _require_alone(convention: Convention, taken: Mapping[str, str], node: Node, names: Names) -> None:
    """No other convention has the same name."""
    table = PREDICATES if convention.sort in PREDICATES else (convention.sort,)
    for role, name in taken.items():
        if CONVENTIONS[role].sort in table and name == node.value:
            message = f"'{node.value}' would be both '{convention.role}' and '{role}'"
            names.findings.add(node.where, "K104", message, "give each a name of its own")
            return
