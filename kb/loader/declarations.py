"""The declarations of a domain file: types, functions, objects, predicates, conventions."""

import re
from collections.abc import Mapping

from cellwright.kb.diagnostics import Source, unknown_name
from cellwright.kb.graphs import strong_components
from cellwright.kb.loader.reader import Reader
from cellwright.kb.loader.symbol_table import SymbolTable
from cellwright.kb.loader.yaml_tree import YamlNode
from cellwright.kb.model.domain_model import (
    BUILT_IN_TYPES,
    OBJECT_TYPE,
    FunctionSignature,
    Kind,
    Predicate,
    Quantity,
    Type,
)
from cellwright.kb.model.name_conventions import CONVENTION_BY_NAME, WITH_ARTICLE, Convention, Sort
from cellwright.kb.terms import Function

PREDICATE_SECTIONS = {
    "statics": Kind.STATIC,
    "derived": Kind.DERIVED,
    "fluents": Kind.FLUENT,
    "events": Kind.EVENT,
}
MAX_DECLARED_INTEGER = 2**31 - 1
TERM_TYPE = "term"  # the parent of a type whose values are only compound terms


def read_declarations(reader: Reader, names: SymbolTable) -> None:
    """Fill the symbol table with the declarations of the file."""
    _read_types(reader, names)
    _read_functions(reader, names)
    read_objects(reader, names)
    _read_predicates(reader, names)
    _read_quantities(reader, names)


def _read_types(reader: Reader, names: SymbolTable) -> None:
    nodes = {
        name: node
        for name, key, node in reader.entries("types")
        if _is_new_type(reader, names, name, key)
    }
    for name, node in nodes.items():
        where = reader.root.descend(("types",)).value[name][0].where
        if isinstance(node.value, list):
            _closed_list(reader, names, name, node, where)
        else:
            parent = OBJECT_TYPE if node.value in (TERM_TYPE, "") else str(node.value)
            names.types[name] = Type(name, parent, (), where)
            if node.value == TERM_TYPE:
                names.term_types.add(name)
    for name in list(names.types):
        _check_parent(names, names.types[name], nodes[name])
    graph = {type_.name: [type_.parent] for type_ in names.types.values()}
    _refuse_cycles(
        graph, {type_.name: type_.where for type_ in names.types.values()}, "type", names
    )


def _is_new_type(reader: Reader, names: SymbolTable, name: str, key: YamlNode) -> bool:
    if name in (*BUILT_IN_TYPES, TERM_TYPE):
        names.findings.add(
            key.where, "K104", f"the type '{name}' is built in", "choose another name"
        )
        return False
    return reader.is_name(name, key)


def _closed_list(
    reader: Reader, names: SymbolTable, name: str, node: YamlNode, where: Source
) -> None:
    constants = list(reader.once(reader.names(node)))
    names.types[name] = Type(name, OBJECT_TYPE, tuple(constant for constant, _ in constants), where)
    names.closed_lists.add(name)
    for constant, item in constants:
        names.add_object(constant, name, item.where)
    if not node.value:
        hint = f"list its constants, or write `{name}: object`"
        names.findings.add(node.where, "K005", f"the closed list '{name}' is empty", hint)


def _check_parent(names: SymbolTable, type_: Type, node: YamlNode) -> None:
    if not names.known_type(type_.parent):
        names.miss_type(type_.parent, names.types, node.where)
    elif type_.parent in BUILT_IN_TYPES and type_.parent != OBJECT_TYPE:
        hint = f"use `{type_.parent}` itself in signatures, or write `{type_.name}: object`"
        names.findings.add(node.where, "K103", f"'{type_.parent}' has no subtypes", hint)
    elif type_.parent in names.closed_lists:
        hint = f"write `{type_.parent}: object` and give each part its own type"
        names.findings.add(
            node.where, "K103", f"'{type_.parent}' is a closed list and has no subtypes", hint
        )


def _refuse_cycles(
    graph: dict[str, list[str]], places: dict[str, Source], kind: str, names: SymbolTable
) -> None:
    for component in strong_components(graph):
        looped = sorted(name for name in component if name in places)
        if len(component) > 1 or component[0] in graph.get(component[0], ()):
            message = f"the {kind} {looped[0]} is defined by itself"
            if len(looped) > 1:
                message = f"the {kind}s {' and '.join(looped)} are defined by each other"
            hint = "break the circle: otherwise terms and types are endless"
            names.findings.add(places[looped[0]], "K109", message, hint)


def _read_functions(reader: Reader, names: SymbolTable) -> None:
    for _, key, node in reader.entries("functions"):
        signature = _read_signature(reader, key, names)
        if signature is None or not _is_new_function(names, signature, key):
            continue
        result = str(node.value)
        _check_result(names, signature.name, result, node)
        arguments = tuple(str(argument) for argument in signature.arguments)
        names.functions[signature.name] = FunctionSignature(
            signature.name, arguments, result, key.where
        )
    graph: dict[str, list[str]] = {name: [] for name in names.functions}
    for function in names.functions.values():
        for argument in function.arguments:
            inner = (
                f.name for f in names.functions.values() if names.is_subtype(f.result, argument)
            )
            graph[function.name].extend(inner)
    _refuse_cycles(graph, {f.name: f.where for f in names.functions.values()}, "function", names)


def _is_new_function(names: SymbolTable, signature: Function, key: YamlNode) -> bool:
    if signature.name in names.functions:
        hint = "give one of them another name"
        names.findings.add(
            key.where, "K104", f"the function '{signature.name}' is declared twice", hint
        )
    elif signature.name in names.objects:
        hint = "give one of them another name"
        names.findings.add(
            key.where, "K104", f"'{signature.name}' is a constant of a closed list already", hint
        )
    elif not signature.arguments:
        hint = "list constants under `objects:`, or in a closed list under `types:`"
        names.findings.add(
            key.where, "K102", f"the function '{signature.name}' has no arguments", hint
        )
    else:
        return True
    return False


def _check_result(names: SymbolTable, name: str, result: str, node: YamlNode) -> None:
    if not names.known_type(result):
        names.miss_type(result, names.types, node.where)
    elif result in BUILT_IN_TYPES and result != OBJECT_TYPE:
        hint = "choose a type that this file declares"
        names.findings.add(node.where, "K103", f"{name}(...) cannot be of type {result}", hint)
    elif result in names.closed_lists:
        hint = f"write `{result}: object`"
        names.findings.add(
            node.where, "K103", f"'{result}' is a closed list: it has no other values", hint
        )


def _read_signature(reader: Reader, key: YamlNode, names: SymbolTable) -> Function | None:
    expression = reader.parse("signature", key)
    if expression is None:
        if match := re.match(r"[a-z][A-Za-z0-9_]*", str(key.value)):
            names.broken.add(match[0])
        return None
    signature: Function = expression.value
    for argument in signature.arguments:
        if not names.known_type(str(argument)):
            place = expression.place(argument) if isinstance(argument, Function) else key.where
            names.miss_type(str(argument), [*names.types, *BUILT_IN_TYPES], place)
    return signature


def read_objects(reader: Reader, names: SymbolTable) -> dict[str, str]:
    """Declare the objects under `objects:` and return them with their types."""
    declared: dict[str, str] = {}
    for type_, key, node in reader.entries("objects"):
        _check_extensible(names, type_, key)
        for name, item in reader.names(node):
            names.add_object(name, type_, item.where)
            declared[name] = type_
    return declared


def _check_extensible(names: SymbolTable, type_: str, key: YamlNode) -> None:
    """Check that a type may have listed objects: it is not numeric, not closed, and not built
    by functions.
    """
    if type_ not in names.types and type_ != OBJECT_TYPE:
        if type_ in BUILT_IN_TYPES:
            names.findings.add(
                key.where, "K103", f"{type_} is built in: its values are not listed", "remove it"
            )
        else:
            names.miss_type(type_, names.types, key.where)
    elif type_ in names.closed_lists:
        hint = "add the constant where the type is declared"
        names.findings.add(key.where, "K104", f"'{type_}' is a closed list", hint)
    elif names.is_term_type(type_):
        hint = f"give it another parent, or a function: `name(...): {type_}`"
        names.findings.add(key.where, "K103", f"only functions build values of '{type_}'", hint)


def _read_predicates(reader: Reader, names: SymbolTable) -> None:
    for section, kind in PREDICATE_SECTIONS.items():
        for _, key, node in reader.entries(section):
            signature = _read_signature(reader, key, names)
            if signature is None or not _is_new_predicate(names, signature, key):
                continue
            weighed = isinstance(node.value, dict) and node.value.get("weight")
            weight = int(weighed[1].value) if weighed and weighed[1].value else None
            arguments = tuple(str(argument) for argument in signature.arguments)
            names.predicates[signature.name] = Predicate(
                signature.name, arguments, kind, weight, key.where
            )
            if kind is Kind.DERIVED:
                names.derived.append(signature.name)


def _read_quantities(reader: Reader, names: SymbolTable) -> None:
    """Declare each quantity as a fluent whose last argument is its value."""
    for _, key, node in reader.entries("quantities"):
        signature = _read_signature(reader, key, names)
        if signature is None or not _is_new_predicate(names, signature, key):
            continue
        match = re.fullmatch(r"\s*(-?\d+)?\s*\.\.\s*(-?\d+)?\s*", str(node.value))
        least, greatest = match.groups() if match else ("1", "0")
        low, high = int(least or -MAX_DECLARED_INTEGER), int(greatest or MAX_DECLARED_INTEGER)
        if not -MAX_DECLARED_INTEGER <= low <= high <= MAX_DECLARED_INTEGER:
            message = f"'{node.value}' is no range of whole numbers"
            hint = "write the least and the greatest value: 0..5000, or one of them: 0.."
            names.findings.add(node.where, "K113", message, hint)
            names.broken.add(signature.name)
            continue
        arguments = (*(str(argument) for argument in signature.arguments), "int")
        name = signature.name
        names.predicates[name] = Predicate(name, arguments, Kind.FLUENT, None, key.where)
        names.quantities[name] = Quantity(name, low, high, key.where)


def _is_new_predicate(names: SymbolTable, signature: Function, key: YamlNode) -> bool:
    earlier = names.predicates.get(signature.name)
    if earlier is not None:
        message = (
            f"'{signature.name}' is declared already, as {earlier.kind.value} in line "
            f"{earlier.where.line}"
        )
    elif names.known_type(signature.name):
        message = f"'{signature.name}' is a type, and every type is also a predicate"
    else:
        return True
    names.findings.add(key.where, "K104", message, "choose another name")
    return False


PREDICATE_SORTS = (Sort.STATIC, Sort.FLUENT)


def read_conventions(reader: Reader, names: SymbolTable) -> dict[str, str]:
    """The conventions that have another name here, with that name. What does not fit is noted."""
    given: dict[str, tuple[str, YamlNode]] = {}
    for role, key, node in reader.entries("conventions"):
        if role in CONVENTION_BY_NAME:
            given[role] = str(node.value), node
        else:
            names.findings.note(unknown_name("convention", role, CONVENTION_BY_NAME, key.where))
    taken = {role: role for role in CONVENTION_BY_NAME if role not in given}
    for role, (name, node) in given.items():
        if _is_declared(CONVENTION_BY_NAME[role], name, node, names):
            _require_alone(CONVENTION_BY_NAME[role], taken, node, names)
        taken[role] = name
    return {role: name for role, (name, _) in given.items()}


def _is_declared(convention: Convention, name: str, node: YamlNode, names: SymbolTable) -> bool:
    """Whether the name is declared as what it should be; if not, that is noted."""
    sort, declared = convention.sort.value, _declared_symbols(convention.sort, names)
    if name not in declared:
        if name not in names.broken:
            word = "predicate" if convention.sort in PREDICATE_SORTS else sort
            names.findings.note(unknown_name(word, name, declared, node.where))
        return False
    arguments: tuple[str, ...] = ()
    if convention.sort in PREDICATE_SORTS:
        sort, arguments = names.predicates[name].kind.value, names.predicates[name].arguments
    elif convention.sort is Sort.FUNCTION:
        arguments = names.functions[name].arguments
    if (deviation := convention.deviation(sort, arguments)) is not None:
        code, reason = deviation
        message = f"'{name}' cannot stand for '{convention.role}': it {reason}"
        hint = (
            f"name {WITH_ARTICLE[convention.sort.value]} such as {convention.written()}: "
            f"{convention.meaning}"
        )
        names.findings.add(node.where, code, message, hint)
    return deviation is None


def _declared_symbols(sort: Sort, names: SymbolTable) -> Mapping[str, object]:
    if sort in PREDICATE_SORTS:
        return names.predicates
    tables: dict[Sort, Mapping[str, object]] = {
        Sort.TYPE: names.types,
        Sort.FUNCTION: names.functions,
        Sort.CONSTANT: names.objects,
    }
    return tables[sort]


def _require_alone(
    convention: Convention, taken: Mapping[str, str], node: YamlNode, names: SymbolTable
) -> None:
    """No other convention has the same name."""
    table = PREDICATE_SORTS if convention.sort in PREDICATE_SORTS else (convention.sort,)
    for role, name in taken.items():
        if CONVENTION_BY_NAME[role].sort in table and name == node.value:
            message = f"'{node.value}' would be both '{convention.role}' and '{role}'"
            names.findings.add(node.where, "K104", message, "give each a name of its own")
            return
