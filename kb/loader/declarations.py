"""The declarations of a domain file: types, functions, objects, predicates."""

import re

from cellwright.kb.diagnostics import Source
from cellwright.kb.graphs import components
from cellwright.kb.loader.names import Names
from cellwright.kb.loader.reader import Reader
from cellwright.kb.loader.tree import Node
from cellwright.kb.model.domain import (
    BUILT_IN_TYPES,
    OBJECT,
    FunctionSignature,
    Kind,
    Predicate,
    Quantity,
    Type,
)
from cellwright.kb.terms import Function

KINDS = {"statics": Kind.STATIC, "derived": Kind.DERIVED, "fluents": Kind.FLUENT, "events": Kind.EVENT}
LARGEST = 2**31 - 1
TERM = "term"  # the parent of a type whose values are only compound terms


def read_declarations(reader: Reader, names: Names) -> None:
    """Fill the symbol table with the declarations of the file."""
    _read_types(reader, names)
    _read_functions(reader, names)
    read_objects(reader, names)
    _read_predicates(reader, names)
    _read_quantities(reader, names)


def _read_types(reader: Reader, names: Names) -> None:
    nodes = {
        name: node for name, key, node in reader.entries("types") if _is_new_type(reader, names, name, key)
    }
    for name, node in nodes.items():
        where = reader.root.descend(("types",)).value[name][0].where
        if isinstance(node.value, list):
            _closed_list(reader, names, name, node, where)
        else:
            parent = OBJECT if node.value in (TERM, "") else str(node.value)
            names.types[name] = Type(name, parent, (), where)
            if node.value == TERM:
                names.term_types.add(name)
    for name in list(names.types):
        _check_parent(names, names.types[name], nodes[name])
    graph = {type_.name: [type_.parent] for type_ in names.types.values()}
    _refuse_cycles(graph, {type_.name: type_.where for type_ in names.types.values()}, "type", names)


def _is_new_type(reader: Reader, names: Names, name: str, key: Node) -> bool:
    if name in (*BUILT_IN_TYPES, TERM):
        names.findings.add(key.where, "K104", f"the type '{name}' is built in", "choose another name")
        return False
    return reader.is_name(name, key)


def _closed_list(reader: Reader, names: Names, name: str, node: Node, where: Source) -> None:
    constants = list(reader.once(reader.names(node)))
    names.types[name] = Type(name, OBJECT, tuple(constant for constant, _ in constants), where)
    names.closed_lists.add(name)
    for constant, item in constants:
        names.add_object(constant, name, item.where)
    if not node.value:
        hint = f"list its constants, or write `{name}: object`"
        names.findings.add(node.where, "K005", f"the closed list '{name}' is empty", hint)


def _check_parent(names: Names, type_: Type, node: Node) -> None:
    if not names.known_type(type_.parent):
        names.miss_type(type_.parent, names.types, node.where)
    elif type_.parent in BUILT_IN_TYPES and type_.parent != OBJECT:
        hint = f"use `{type_.parent}` itself in signatures, or write `{type_.name}: object`"
        names.findings.add(node.where, "K103", f"'{type_.parent}' has no subtypes", hint)
    elif type_.parent in names.closed_lists:
        hint = f"write `{type_.parent}: object` and give each part its own type"
        names.findings.add(node.where, "K103", f"'{type_.parent}' is a closed list and has no subtypes", hint)


def _refuse_cycles(graph: dict[str, list[str]], places: dict[str, Source], kind: str, names: Names) -> None:
    for component in components(graph):
        looped = sorted(name for name in component if name in places)
        if len(component) > 1 or component[0] in graph.get(component[0], ()):
            message = f"the {kind} {looped[0]} is defined by itself"
            if len(looped) > 1:
                message = f"the {kind}s {' and '.join(looped)} are defined by each other"
            hint = "break the circle: otherwise terms and types are endless"
            names.findings.add(places[looped[0]], "K109", message, hint)


def _read_functions(reader: Reader, names: Names) -> None:
    for _, key, node in reader.entries("functions"):
        signature = _signature(reader, key, names)
        if signature is None or not _is_new_function(names, signature, key):
            continue
        result = str(node.value)
        _check_result(names, signature.name, result, node)
        arguments = tuple(str(argument) for argument in signature.arguments)
        names.functions[signature.name] = FunctionSignature(signature.name, arguments, result, key.where)
    graph: dict[str, list[str]] = {name: [] for name in names.functions}
    for function in names.functions.values():
        for argument in function.arguments:
            inner = (f.name for f in names.functions.values() if names.is_subtype(f.result, argument))
            graph[function.name].extend(inner)
    _refuse_cycles(graph, {f.name: f.where for f in names.functions.values()}, "function", names)


def _is_new_function(names: Names, signature: Function, key: Node) -> bool:
    if signature.name in names.functions:
        hint = "give one of them another name"
        names.findings.add(key.where, "K104", f"the function '{signature.name}' is declared twice", hint)
    elif signature.name in names.objects:
        hint = "give one of them another name"
        names.findings.add(
            key.where, "K104", f"'{signature.name}' is a constant of a closed list already", hint
        )
    elif not signature.arguments:
        hint = "list constants under `objects:`, or in a closed list under `types:`"
        names.findings.add(key.where, "K102", f"the function '{signature.name}' has no arguments", hint)
    else:
        return True
    return False


def _check_result(names: Names, name: str, result: str, node: Node) -> None:
    if not names.known_type(result):
        names.miss_type(result, names.types, node.where)
    elif result in BUILT_IN_TYPES and result != OBJECT:
        hint = "choose a type that this file declares"
        names.findings.add(node.where, "K103", f"{name}(...) cannot be of type {result}", hint)
    elif result in names.closed_lists:
        hint = f"write `{result}: object`"
        names.findings.add(node.where, "K103", f"'{result}' is a closed list: it has no other values", hint)


def _signature(reader: Reader, key: Node, names: Names) -> Function | None:
    expression = reader.parse("signature", key)
    if expression is None:
        if found := re.match(r"[a-z][A-Za-z0-9_]*", str(key.value)):
            names.broken.add(found[0])
        return None
    signature: Function = expression.value
    for argument in signature.arguments:
        if not names.known_type(str(argument)):
            place = expression.place(argument) if isinstance(argument, Function) else key.where
            names.miss_type(str(argument), [*names.types, *BUILT_IN_TYPES], place)
    return signature


def read_objects(reader: Reader, names: Names) -> dict[str, str]:
    """Declare the objects under `objects:` and return them with their types."""
    declared: dict[str, str] = {}
    for type_, key, node in reader.entries("objects"):
        _check_extensible(names, type_, key)
        for name, item in reader.names(node):
            names.add_object(name, type_, item.where)
            declared[name] = type_
    return declared


def _check_extensible(names: Names, type_: str, key: Node) -> None:
    """Check that a type may have listed objects: it is not numeric, not closed, and not built by functions."""
    if type_ not in names.types and type_ != OBJECT:
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


def _read_predicates(reader: Reader, names: Names) -> None:
    for section, kind in KINDS.items():
        for _, key, node in reader.entries(section):
            signature = _signature(reader, key, names)
            if signature is None or not _is_new_predicate(names, signature, key):
                continue
            weighed = isinstance(node.value, dict) and node.value.get("weight")
            weight = int(weighed[1].value) if weighed and weighed[1].value else None
            arguments = tuple(str(argument) for argument in signature.arguments)
            names.predicates[signature.name] = Predicate(signature.name, arguments, kind, weight, key.where)
            if kind is Kind.DERIVED:
                names.derived.append(signature.name)


def _read_quantities(reader: Reader, names: Names) -> None:
    """Declare each quantity as a fluent whose last argument is its value."""
    for _, key, node in reader.entries("quantities"):
        signature = _signature(reader, key, names)
        if signature is None or not _is_new_predicate(names, signature, key):
            continue
        found = re.fullmatch(r"\s*(-?\d+)?\s*\.\.\s*(-?\d+)?\s*", str(node.value))
        least, greatest = found.groups() if found else ("1", "0")
        low, high = int(least or -LARGEST), int(greatest or LARGEST)
        if not -LARGEST <= low <= high <= LARGEST:
            message = f"'{node.value}' is no range of whole numbers"
            hint = "write the least and the greatest value: 0..5000, or one of them: 0.."
            names.findings.add(node.where, "K113", message, hint)
            names.broken.add(signature.name)
            continue
        arguments = (*(str(argument) for argument in signature.arguments), "int")
        name = signature.name
        names.predicates[name] = Predicate(name, arguments, Kind.FLUENT, None, key.where)
        names.quantities[name] = Quantity(name, low, high, key.where)


def _is_new_predicate(names: Names, signature: Function, key: Node) -> bool:
    other = names.predicates.get(signature.name)
    if other is not None:
        message = f"'{signature.name}' is declared already, as {other.kind.value} in line {other.where.line}"
    elif names.known_type(signature.name):
        message = f"'{signature.name}' is a type, and every type is also a predicate"
    else:
        return True
    names.findings.add(key.where, "K104", message, "choose another name")
    return False
