"""The ASP files of a domain: static rules stay text, rules that read fluents are parsed."""

import functools
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

from cellwright.kb.asp import AspError
from cellwright.kb.asp.rule_compiler import NotCompilable, compile_rule
from cellwright.kb.asp.statements import (
    ParsedStatement,
    RefusedStatement,
    read_statements,
    unsafe_rules,
)
from cellwright.kb.diagnostics import Source, nearest_hint
from cellwright.kb.files import File, is_file, path_below
from cellwright.kb.graphs import strong_components
from cellwright.kb.loader.missing_stops import lacking_stop
from cellwright.kb.loader.reader import Reader
from cellwright.kb.loader.symbol_table import SymbolTable, count_of
from cellwright.kb.loader.yaml_tree import SHORT_FILE_CHARACTERS, YamlNode
from cellwright.kb.model.domain_model import BUILT_IN_TYPES, NUMERIC_TYPES, OBJECT_TYPE, Kind, Rule
from cellwright.kb.model.statement import Sign, Signature, Statement

Read = list[ParsedStatement]


def read_rules(
    reader: Reader, names: SymbolTable, folder: Path
) -> tuple[list[Statement], list[Rule]]:
    """The statements in the files under `include:`.

    Derived predicates that only read statics become static.
    """
    read: Read = []
    included = (
        (node.value, node) for node in reader.items("include") if isinstance(node.value, str)
    )
    by_file: dict[str, list[tuple[str, YamlNode]]] = {}
    for name, node in included:
        by_file.setdefault(str(node.file.user() or ""), []).append((name, node))
    for name, node in (entry for includes in by_file.values() for entry in reader.once(includes)):
        here = folder if node.file.user() is None else Path(node.file.path).parent
        if (target := _included_path(reader, name, node, here)) is not None:
            read.extend(_file_statements(node.file.beside(target), names))
    fluent = _depending_on_fluents(read, names)
    for predicate in list(names.predicates.values()):
        if (
            predicate.kind is Kind.DERIVED
            and (predicate.name, len(predicate.arguments)) not in fluent
        ):
            names.predicates[predicate.name] = replace(predicate, kind=Kind.STATIC)
    _check_statements(read, names)
    return _sort_rules(read, fluent, names)


def _included_path(reader: Reader, name: str, node: YamlNode, folder: Path) -> Path | None:
    """The file that an include names, if its real path is inside the folder of the domain."""
    target = path_below(folder, name)
    if target is None:
        message = f"'{name[:60]}' leads outside the domain's folder"
        reader.findings.add(node.where, "K203", message, "copy the file beside domain.yaml")
    elif not is_file(target):
        near = nearest_hint(name, [path.name for path in folder.glob("*.lp")])
        hint = near or "the name is relative to domain.yaml"
        reader.findings.add(
            node.where, "K203", f"there is no file '{name[:60]}' beside the domain", hint
        )
    else:
        return target
    return None


def _file_statements(file: File, names: SymbolTable) -> Read:
    statements: Read = []
    try:
        for statement in (_remembered if len(file.text) <= SHORT_FILE_CHARACTERS else _parse_file)(
            file
        ):
            if isinstance(statement, RefusedStatement):
                names.findings.add(
                    statement.where, statement.code, statement.message, statement.hint
                )
            else:
                statements.append(statement)
    except AspError as error:
        hint = "each statement ends with '.', and variables begin with a capital letter"
        for number, (line, column, message) in enumerate(error.messages):
            if not number and (offset := lacking_stop(file, line, column)) is not None:
                names.findings.add(file.at(offset), "K201", "a '.' is missing here", hint)
                break
            names.findings.add(file.line(line, column), "K201", message, hint)
    return statements


def _parse_file(file: File) -> list[ParsedStatement | RefusedStatement]:
    return list(read_statements(file.text, file.line))


_remembered = functools.lru_cache(64)(_parse_file)


def _depending_on_fluents(read: Read, names: SymbolTable) -> set[Signature]:
    changing = {
        (p.name, len(p.arguments))
        for p in names.predicates.values()
        if p.kind in (Kind.FLUENT, Kind.EVENT)
    }
    readers: dict[Signature, set[Signature]] = {}
    for statement in _read_values(read):
        if statement.defines:
            for use, _ in statement.uses:
                readers.setdefault(use, set()).add(statement.defines)
    waiting = list(changing)
    while waiting:
        more = readers.get(waiting.pop(), set()) - changing
        changing |= more
        waiting.extend(more)
    return changing


def _check_statements(read: Read, names: SymbolTable) -> None:
    known = _known_predicates(read, names)
    constants = {statement.constant for statement in _read_values(read) if statement.constant}
    for statement in _read_values(read):
        if statement.constant:
            _check_constant(statement.constant, statement.where, names)
        _check_reserved(statement, names)
        for use, _ in statement.uses:
            if use not in known and use[0] not in names.broken and not use[0].startswith("_"):
                _report_unknown(use, known, statement.where, names)
        if statement.defines:
            _check_head(statement.defines, statement.where, names)
        _check_arguments(statement, names, constants)
    for statement, said in unsafe_rules(
        [statement for statement in _read_values(read) if not statement.constant]
    ):
        message = f"unsafe: nothing binds {said}" if said else "clingo refuses this rule"
        hint = "use each variable in an atom of the body that is not negated"
        names.findings.add(statement.where, "K105" if said else "K201", message, hint)
    _check_strata(read, names)


def _known_predicates(read: Read, names: SymbolTable) -> set[Signature]:
    declared = {(p.name, len(p.arguments)) for p in names.predicates.values()}
    types = {(name, 1) for name in (*names.types, OBJECT_TYPE)}
    return (
        declared
        | types
        | {statement.defines for statement in _read_values(read) if statement.defines}
    )


def _report_unknown(
    use: Signature, known: Iterable[Signature], where: Source, names: SymbolTable
) -> None:
    name, arity = use
    arities = sorted(other for known_name, other in known if known_name == name)
    if arities:
        message = count_of(name, arities[0], arity)
        names.findings.add(where, "K102", message, "count its arguments")
    else:
        hint = (
            nearest_hint(name, [known_name for known_name, _ in known])
            or "declare it, or define it by a rule"
        )
        names.findings.add(where, "K101", f"unknown predicate '{name}'", hint)


def _check_reserved(statement: Statement, names: SymbolTable) -> None:
    """Report predicates, functions and constants whose names are reserved for the engine."""
    for name in dict.fromkeys(name for name in statement.names if name.startswith("_")):
        hint = "names that begin with '_' belong to the engine"
        names.findings.add(statement.where, "K112", f"'{name}' is reserved", hint)


def _check_constant(name: str, where: Source, names: SymbolTable) -> None:
    if name in names.objects or name in names.functions or name.startswith("_"):
        message = f"#const would replace '{name}' everywhere"
        names.findings.add(where, "K104", message, "give the constant a name of its own")


def _check_head(signature: Signature, where: Source, names: SymbolTable) -> None:
    name, arity = signature
    predicate = names.predicates.get(name)
    if predicate and len(predicate.arguments) != arity:
        hint = f"it is {name}({', '.join(predicate.arguments)})"
        names.findings.add(where, "K102", count_of(name, len(predicate.arguments), arity), hint)
    elif predicate and predicate.kind in (Kind.FLUENT, Kind.EVENT):
        hint = "operators and deductive operators can change it; or declare it under `derived:`"
        message = f"'{name}' is declared under `{predicate.kind.value}s:`: rules cannot define it"
        names.findings.add(where, "K108", message, hint)
    elif arity == 1 and (
        name in BUILT_IN_TYPES or (name in names.types and not _contains_numbers(name, names))
    ):
        hint = "list its objects under `objects:`"
        names.findings.add(where, "K108", f"'{name}' is a type: rules cannot define it", hint)


def _contains_numbers(type_: str, names: SymbolTable) -> bool:
    """Whether terms of this type contain numbers, which cannot be enumerated: then rules define
    which terms there are.
    """
    built = (function for function in names.functions.values() if function.result == type_)
    return any(argument in NUMERIC_TYPES for function in built for argument in function.arguments)


def _check_arguments(statement: Statement, names: SymbolTable, constants: set[str]) -> None:
    """Check constants in predicates.

    An unknown one gets a warning, as a problem may declare it; a wrong type is an error.
    """
    for (name, arity), number, constant in statement.constants:
        predicate = names.predicates.get(name)
        if predicate is None or len(predicate.arguments) != arity or constant in constants:
            continue
        expected, actual = predicate.arguments[number], names.objects.get(constant)
        if actual is None:
            hint = nearest_hint(constant, names.objects)
            if hint:
                message = f"no object is called '{constant}'"
                names.findings.add(statement.where, "K101", message, hint, warning=True)
        elif not names.is_subtype(actual, expected):
            message = f"{constant} is of type {actual}, but {name} takes {expected} here"
            names.findings.add(statement.where, "K103", message, names.examples(expected))


def _sort_rules(
    read: Read, fluent: set[Signature], names: SymbolTable
) -> tuple[list[Statement], list[Rule]]:
    asp: list[Statement] = []
    rules: list[Rule] = []
    for parsed in read:
        statement = parsed.statement
        if statement.defines not in fluent and not any(use in fluent for use, _ in statement.uses):
            asp.append(statement)
        elif statement.defines is None:
            hint = "deny it with a deductive operator, or make it a precondition"
            names.findings.add(statement.where, "K202", "a constraint cannot read fluents", hint)
        else:
            rules.extend(_make_rules(parsed, statement.defines[0], statement.where, names))
    _warn_of_undefined(read, names)
    return asp, rules


def _make_rules(
    parsed: ParsedStatement, name: str, where: Source, names: SymbolTable
) -> Iterator[Rule]:
    predicate = names.predicates.get(name)
    if predicate is None:
        hint = f"declare `{name}` with its types under `derived:`"
        names.findings.add(where, "K108", f"'{name}' depends on fluents", hint)
    elif predicate.kind is Kind.STATIC:
        hint = f"declare `{name}` under `derived:`"
        names.findings.add(where, "K108", f"'{name}' is static, but this rule reads fluents", hint)
    elif predicate.kind is Kind.DERIVED:
        try:
            yield Rule(*compile_rule(parsed.tree), where)
        except NotCompilable as error:
            hint = (
                "a rule over fluents can contain only atoms, comparisons, `not`, #count, #sum, "
                "#min and #max"
            )
            message = f"this rule reads fluents and cannot be compiled, because of '{error}'"
            names.findings.add(where, "K202", message, hint)


def _warn_of_undefined(read: Read, names: SymbolTable) -> None:
    """Warn of derived predicates without a rule, because they are always false."""
    defined = {statement.defines for statement in _read_values(read)}
    for name in names.derived:
        predicate = names.predicates.get(name)
        if predicate and (name, len(predicate.arguments)) not in defined:
            message, hint = (
                f"no rule defines '{name}'",
                "add a rule to an .lp file under `include:`",
            )
            names.findings.add(predicate.where, "K310", message, hint, warning=True)


def _check_strata(read: Read, names: SymbolTable) -> None:
    graph: dict[Signature, list[Signature]] = {}
    for statement in _read_values(read):
        if statement.defines:
            graph.setdefault(statement.defines, []).extend(use for use, _ in statement.uses)
    component = {sig: index for index, part in enumerate(strong_components(graph)) for sig in part}
    for statement in _read_values(read):
        for use, _ in statement.uses:
            if use[0] in names.quantities:
                message = f"a rule cannot read the quantity '{use[0]}'"
                hint = "compare it in preconditions: volume(Bottle) >= 5"
                names.findings.add(statement.where, "K202", message, hint)
        for use, sign in statement.uses:
            lower = sign is not Sign.POSITIVE
            if (
                lower
                and statement.defines
                and component.get(statement.defines) == component.get(use)
            ):
                message = f"'{statement.defines[0]}' depends on its own negation"
                hint = "negate only predicates that do not depend on it"
                names.findings.add(statement.where, "K201", message, hint)


def _read_values(read: Read) -> Iterator[Statement]:
    return (parsed.statement for parsed in read)
