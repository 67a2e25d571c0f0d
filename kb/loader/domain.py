"""`domain.yaml` and the ASP files it includes become a `Domain`."""

from dataclasses import replace
from pathlib import Path

import networkx as nx

from kb.asp import AspError
from kb.asp.statements import Refused, Signature, Statement, statements
from kb.commands import check_phrases
from kb.diagnostics import Source, nearest
from kb.loader.declarations import read_declarations
from kb.loader.names import Names
from kb.loader.operators import read_deductive_operators, read_defaults, read_operators
from kb.loader.reader import Findings, Reader, require, validate_shape
from kb.loader.tree import File, read_file
from kb.model.domain import NUMERIC_TYPES, AspText, Domain, Kind, Phrase, Rule
from kb.syntax import ExpressionError, parse


def read_domain(path: Path, findings: Findings) -> tuple[Domain, Names]:
    """The domain in a file and its symbol table. Raises `InvalidInput` when its shape is wrong; the rest is noted."""
    reader = Reader.of(read_file(path), findings)
    if not validate_shape(reader, "domain"):
        require(findings)
    reader.time_unit = reader.text("units", "time") or "s"
    names = Names(findings)
    read_declarations(reader, names)
    asp, rules = _read_asp(reader, names, path.parent)
    domain = Domain(
        str(reader.root.descend(("domain",)).value),
        names.types,
        names.functions,
        dict(names.objects),
        names.predicates,
        operators=read_operators(reader, names),
        deductive_operators=read_deductive_operators(reader, names),
        defaults=read_defaults(reader, names),
        asp=tuple(asp),
        rules=tuple(rules),
        time_unit=reader.time_unit,
        words=_words(reader),
        phrases=tuple(_phrases(reader)),
        path=str(path),
    )
    findings.diagnostics.extend(check_phrases(domain, reader.place_under("commands")))
    return domain, names


def _words(reader: Reader) -> dict[str, tuple[str, ...]]:
    entries = reader.entries("commands", "words")
    return {key: tuple(str(item.value) for item in node.value) for key, _, node in entries}


def _phrases(reader: Reader) -> list[Phrase]:
    found = []
    for node in reader.items("commands", "phrases"):
        value = {key: str(item.value) for key, (_, item) in node.value.items()}
        if bool(value.get("goal")) == bool(value.get("stage")):
            reader.findings.add(
                node.where, "K005", "a phrase has a goal or a stage", "give exactly one of them"
            )
        found.append(Phrase(value["say"], value.get("goal", ""), value.get("stage", ""), node.where))
    return found


def _read_asp(reader: Reader, names: Names, folder: Path) -> tuple[list[AspText], list[Rule]]:
    read: list[tuple[Statement, Source]] = []
    for node in reader.items("include"):
        target = (folder / str(node.value)).resolve()
        if not target.is_relative_to(folder.resolve()) or Path(str(node.value)).is_absolute():
            reader.findings.add(node.where, "K203", "an include must stay inside the domain folder")
        elif not target.is_file():
            near = nearest(str(node.value), [each.name for each in folder.glob("*.lp")])
            reader.findings.add(node.where, "K203", f"no file '{node.value}' beside the domain", near)
        else:
            read.extend(_statements(read_file(target, str(folder / str(node.value))), names))
    return _sort_rules(read, names)


def _statements(file: File, names: Names) -> list[tuple[Statement, Source]]:
    found: list[tuple[Statement, Source]] = []
    try:
        for statement in statements(file.text):
            where = _line(file, statement.line, statement.column)
            if isinstance(statement, Refused):
                names.findings.add(where, "K202", statement.message, statement.hint)
            else:
                found.append((statement, where))
    except AspError as error:
        for line, column, message in error.messages:
            names.findings.add(_line(file, line, column), "K201", message)
    return found


def _line(file: File, line: int, column: int) -> Source:
    if not 1 <= line <= len(file.line_starts):
        return Source(file.path)
    return file.at(min(file.line_starts[line - 1] + max(column - 1, 0), len(file.text)))


def _sort_rules(read: list[tuple[Statement, Source]], names: Names) -> tuple[list[AspText], list[Rule]]:
    """Statics for clingo as they stand; rules that depend on fluents parsed, for planning and checking."""
    defined: set[Signature | None] = {statement.signature for statement, _ in read}
    fluent = _depending_on_fluents(read, names)
    for predicate in list(names.predicates.values()):
        if predicate.kind is Kind.DERIVED and (predicate.name, len(predicate.arguments)) not in fluent:
            names.predicates[predicate.name] = replace(
                predicate, kind=Kind.STATIC
            )  # rules over statics alone
    asp: list[AspText] = []
    rules: list[Rule] = []
    for statement, where in read:
        _check_names(statement, where, defined, names)
        reads_fluents = statement.signature in fluent or any(use in fluent for use, _ in statement.uses)
        if not reads_fluents:
            asp.append(AspText(statement.text, where))
        elif statement.constraint or statement.signature is None:
            hint = "deny it with a deductive operator, or make it a precondition"
            names.findings.add(where, "K202", "a constraint cannot read fluents", hint)
        else:
            rules.extend(_rule(statement, where, names))
    _check_strata(read, names)
    return asp, rules


def _depending_on_fluents(read: list[tuple[Statement, Source]], names: Names) -> set[Signature]:
    changing = {
        (p.name, len(p.arguments)) for p in names.predicates.values() if p.kind in (Kind.FLUENT, Kind.EVENT)
    }
    while True:
        more = {
            statement.signature
            for statement, _ in read
            if statement.signature and any(use in changing for use, _ in statement.uses)
        }
        if more <= changing:
            return changing
        changing |= {signature for signature in more if signature}


def _check_names(statement: Statement, where: Source, defined: set[Signature | None], names: Names) -> None:
    known = (
        {(p.name, len(p.arguments)) for p in names.predicates.values()}
        | {(t, 1) for t in names.types}
        | defined
    )
    for use, _ in statement.uses:
        if use not in known:
            near = nearest(use[0], [signature[0] for signature in known if signature])
            names.findings.add(where, "K101", f"unknown predicate '{use[0]}/{use[1]}'", near)
    if statement.signature:
        name, arity = statement.signature
        predicate = names.predicates.get(name)
        if predicate and len(predicate.arguments) != arity:
            names.findings.add(where, "K102", f"{name} takes {len(predicate.arguments)} arguments")
        elif predicate and predicate.kind in (Kind.FLUENT, Kind.EVENT):
            names.findings.add(where, "K108", f"'{name}' is {predicate.kind.value}: rules cannot define it")
        elif name in names.types and not _counted(name, names):
            names.findings.add(where, "K108", f"'{name}' is a type: list its objects under `objects:`")


def _counted(type_: str, names: Names) -> bool:
    """Whether terms of this type are built from numbers, which have no extension: rules say which there are."""
    built = (function for function in names.functions.values() if function.result == type_)
    return any(argument in NUMERIC_TYPES for function in built for argument in function.arguments)


def _rule(statement: Statement, where: Source, names: Names) -> list[Rule]:
    assert statement.signature is not None
    predicate = names.predicates.get(statement.signature[0])
    if predicate is None or predicate.kind is not Kind.DERIVED:
        name = statement.signature[0]
        names.findings.add(where, "K108", f"'{name}' depends on fluents", f"declare {name} under `derived:`")
        return []
    try:
        head = parse("atom", statement.head or "").value
        text = ", ".join(statement.body)
        body = parse("body", text).value if text else ()
    except ExpressionError as error:
        hint = "over fluents: atoms, comparisons and `not` alone"
        names.findings.add(
            where, "K202", f"this rule reads fluents and cannot be compiled: {error.message}", hint
        )
        return []
    return [Rule(head, body, where)]


def _check_strata(read: list[tuple[Statement, Source]], names: Names) -> None:
    graph: nx.DiGraph[Signature] = nx.DiGraph()
    for statement, _ in read:
        if statement.signature:
            graph.add_edges_from((statement.signature, use) for use, _ in statement.uses)
    component = {
        sig: index for index, part in enumerate(nx.strongly_connected_components(graph)) for sig in part
    }
    for statement, where in read:
        for use, negated in statement.uses:
            if negated and statement.signature and component.get(statement.signature) == component.get(use):
                names.findings.add(where, "K201", f"'{statement.signature[0]}' depends on its own negation")
