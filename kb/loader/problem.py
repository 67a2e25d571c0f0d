"""A problem file becomes a `Problem` on top of its domain."""

import itertools
from collections.abc import Iterator
from dataclasses import replace

from kb.asp import AspError, ground_term
from kb.diagnostics import unknown_name
from kb.loader.command import commanded
from kb.loader.declarations import read_objects
from kb.loader.names import Names, Typing
from kb.loader.operators import READABLE
from kb.loader.reader import Expression, Findings, Reader
from kb.loader.tree import Node
from kb.model.conditions import TRUE, And, Condition, free_variables
from kb.model.domain import Domain, Kind
from kb.model.problem import Chain, Problem
from kb.syntax import Parsed
from kb.terms import Atom, Function, Term, Variable, is_ground, substitute_atom, variables


def read_problem(reader: Reader, domain: Domain, domain_names: Names, findings: Findings) -> Problem:
    """The problem in a file whose shape is right; what is wrong inside is noted."""
    reader.time_unit = domain.time_unit
    names = Names(
        findings,
        dict(domain_names.types),
        dict(domain_names.functions),
        dict(domain.objects),
        dict(domain.predicates),
    )
    objects = read_objects(reader, names)
    problem = Problem(
        str(reader.root.descend(("problem",)).value),
        domain,
        objects,
        statics=tuple(_facts(reader, names, "statics", (Kind.STATIC,))),
        initial=tuple(_facts(reader, names, "initial", (Kind.FLUENT,))),
        goal=_goal(reader, names),
        chains=tuple(_chains(reader, names)),
        complete=str(reader.root.descend(("complete",)).value) == "true",
        path=reader.root.file.path,
        where=reader.root.where,
    )
    return commanded(problem, reader)


def _facts(reader: Reader, names: Names, section: str, kinds: tuple[Kind, ...]) -> Iterator[Atom]:
    for node in reader.items(section):
        expression = _fact(node) or reader.parse("atoms", node)
        for atom in expression.value if expression else ():
            Typing(names).atom(atom, expression, kinds)
            if is_ground(atom):
                yield atom
            else:
                variable = next(variables(atom))
                names.findings.add(expression.place(variable), "K105", f"a fact has no variables: {variable}")


def _fact(node: Node) -> Expression | None:
    """The common case, one ground atom, read by clingo: problems hold thousands of them."""
    text = node.value
    if not isinstance(text, str) or (any(mark in text for mark in '"_.;+-*/ \\|') and not _simple(text)):
        return None
    try:
        atom = ground_term(text)
    except AspError:
        return None
    return Expression((atom,), Parsed((atom,)), node) if isinstance(atom, Function) else None


def _simple(text: str) -> bool:
    return text.replace("_", "a").replace(" ", "").replace("(", "").replace(")", "").replace(
        ",", ""
    ).isalnum() and (" _" not in text and "(_" not in text and ",_" not in text)


def _goal(reader: Reader, names: Names) -> Condition:
    parts: list[Condition] = []
    for node in reader.items("goals"):
        if expression := reader.parse("conditions", node):
            parts.append(goal_condition(expression, names))
    return And(tuple(parts)) if parts else TRUE


def goal_condition(expression: Expression, names: Names) -> Condition:
    """A parsed goal, checked and typed; its variables and `_` mean "some"."""
    typing = Typing(names)
    condition = And(expression.value)
    typing.condition(condition, expression, READABLE)
    for variable in free_variables(condition):
        names.findings.add(
            expression.place(variable), "K105", f"a goal has no variables: {variable}", "write '_' for some"
        )
    return typing.quantified(condition, expression)


def _chains(reader: Reader, names: Names) -> Iterator[Chain]:
    entries = reader.items("workflow")
    titles = [
        str(node.value["name"][1].value) if "name" in node.value else str(i + 1)
        for i, node in enumerate(entries)
    ]
    groups: dict[str, list[str]] = {}
    for index, title in enumerate(titles):
        after: list[str] = []
        for node in reader.items("workflow", index, "after"):
            if node.value not in groups:
                names.findings.diagnostics.append(
                    unknown_name("earlier workflow", str(node.value), groups, node.where)
                )
            after.extend(groups.get(str(node.value), []))
        chains = list(_entry_chains(reader, names, index, title))
        groups[title] = [chain.name for chain in chains]
        yield from (replace(chain, after=tuple(after)) for chain in chains)


def _entry_chains(reader: Reader, names: Names, index: int, title: str) -> Iterator[Chain]:
    stages = reader.expression("atoms", "workflow", index, "stages")
    if stages is None:
        return
    choices: list[list[tuple[Variable, str]]] = []
    typing = Typing(names)
    for variable, _, node in reader.entries("workflow", index, "for"):
        listed = reader.names(node)
        for name, where in listed:
            if name not in names.objects:
                names.findings.diagnostics.append(unknown_name("object", name, names.objects, where))
        choices.append([(Variable(variable), name) for name, _ in listed])
    for atom in stages.value:
        typing.atom(atom, stages, (Kind.EVENT, Kind.FLUENT))
        for variable in variables(atom):
            if variable not in {options[0][0] for options in choices if options}:
                names.findings.add(stages.place(variable), "K105", f"variable {variable} is not under `for:`")
    for combination in itertools.product(*choices):
        bindings: dict[Variable, Term] = {variable: Function(name) for variable, name in combination}
        subject = Function(combination[0][1]) if combination else _subject(reader, names, index)
        label = ",".join(name for _, name in combination)
        bound = tuple(substitute_atom(atom, bindings) for atom in stages.value)
        for atom in bound:
            Typing(names).atom(atom, stages, (Kind.EVENT, Kind.FLUENT))
        yield Chain(f"{title}:{label}" if label else title, bound, (), subject, stages.node.where)


def _subject(reader: Reader, names: Names, index: int) -> Function | None:
    expression = reader.expression("atom", "workflow", index, "subject")
    if expression and expression.value.name not in names.objects:
        known = names.objects
        names.findings.diagnostics.append(
            unknown_name("object", expression.value.name, known, expression.place())
        )
    return expression.value if expression else None
