"""The declarations of a domain file: types, functions, objects, predicates."""

import networkx as nx

from kb.diagnostics import Source, unknown_name
from kb.loader.names import Names
from kb.loader.reader import Reader
from kb.loader.tree import Node
from kb.model.domain import BUILT_IN_TYPES, OBJECT, FunctionSignature, Kind, Predicate, Type
from kb.terms import Function

KINDS = {"statics": Kind.STATIC, "derived": Kind.DERIVED, "fluents": Kind.FLUENT, "events": Kind.EVENT}
TERM = "term"  # the parent of a type whose values are compound terms alone


def read_declarations(reader: Reader, names: Names) -> None:
    """Fill the symbol table from the file's declarations."""
    _read_types(reader, names)
    _read_functions(reader, names)
    read_objects(reader, names)
    _read_predicates(reader, names)


def _read_types(reader: Reader, names: Names) -> None:
    for name, key, node in reader.entries("types"):
        if name in BUILT_IN_TYPES:
            names.findings.add(key.where, "K104", f"'{name}' is built in")
        elif isinstance(node.value, list):
            constants = reader.names(node)
            names.types[name] = Type(name, OBJECT, tuple(constant for constant, _ in constants), key.where)
            for constant, where in constants:
                names.add_object(constant, name, where)
        else:
            parent = OBJECT if node.value in (TERM, "", None) else str(node.value)
            names.types[name] = Type(name, parent, (), key.where)
    for type_ in names.types.values():
        if not names.known_type(type_.parent):
            place = reader.root.descend(("types", type_.name)).where
            names.findings.diagnostics.append(unknown_name("type", type_.parent, names.types, place))
    graph = nx.DiGraph((type_.name, type_.parent) for type_ in names.types.values())
    _refuse_cycles(graph, {type_.name: type_.where for type_ in names.types.values()}, "type", names)


def _refuse_cycles(graph: "nx.DiGraph[str]", places: dict[str, Source], kind: str, names: Names) -> None:
    for component in nx.strongly_connected_components(graph):
        looped = sorted(name for name in component if name in places)
        if len(component) > 1 or any(graph.has_edge(name, name) for name in component):
            names.findings.add(places[looped[0]], "K109", f"{kind} '{looped[0]}' is defined by itself")


def _read_functions(reader: Reader, names: Names) -> None:
    for _, key, node in reader.entries("functions"):
        signature = _signature(reader, key, names)
        if signature is None:
            continue
        if signature.name in names.functions:
            names.findings.add(key.where, "K104", f"function '{signature.name}' is declared twice")
        result = str(node.value)
        if not names.known_type(result):
            names.findings.diagnostics.append(unknown_name("type", result, names.types, node.where))
        arguments = tuple(str(argument) for argument in signature.arguments)
        names.functions[signature.name] = FunctionSignature(signature.name, arguments, result, key.where)
    graph: nx.DiGraph[str] = nx.DiGraph()
    for function in names.functions.values():
        for argument in function.arguments:
            inner = (f.name for f in names.functions.values() if names.is_subtype(f.result, argument))
            graph.add_edges_from((function.name, name) for name in inner)
    _refuse_cycles(graph, {f.name: f.where for f in names.functions.values()}, "function", names)


def _signature(reader: Reader, key: Node, names: Names) -> Function | None:
    expression = reader.parse("signature", key)
    if expression is None:
        return None
    signature: Function = expression.value
    for argument in signature.arguments:
        if not names.known_type(str(argument)):
            place = expression.place(argument) if isinstance(argument, Function) else key.where
            names.findings.diagnostics.append(unknown_name("type", str(argument), names.types, place))
    return signature


def read_objects(reader: Reader, names: Names) -> dict[str, str]:
    """Declare the objects under `objects:` and return them with their types."""
    declared: dict[str, str] = {}
    for type_, key, node in reader.entries("objects"):
        if type_ not in names.types:
            names.findings.diagnostics.append(unknown_name("type", type_, names.types, key.where))
        elif names.types[type_].constants:
            names.findings.add(
                key.where,
                "K104",
                f"'{type_}' is a closed list",
                "add the constant where the type is declared",
            )
        for name, where in reader.names(node):
            names.add_object(name, type_, where)
            declared[name] = type_
    return declared


def _read_predicates(reader: Reader, names: Names) -> None:
    for section, kind in KINDS.items():
        for _, key, node in reader.entries(section):
            signature = _signature(reader, key, names)
            if signature is None:
                continue
            if signature.name in names.predicates or names.known_type(signature.name):
                names.findings.add(key.where, "K104", f"'{signature.name}' is declared already")
                continue
            weight = (
                node.descend(("weight",)).value
                if isinstance(node.value, dict) and "weight" in node.value
                else None
            )
            arguments = tuple(str(argument) for argument in signature.arguments)
            names.predicates[signature.name] = Predicate(
                signature.name, arguments, kind, int(weight) if weight is not None else None, key.where
            )
