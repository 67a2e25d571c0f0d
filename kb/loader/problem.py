"""A problem file becomes a `Problem` on top of its domain."""

from collections.abc import Iterator

from kb.asp import AspError, ground_term
from kb.loader.command import commanded
from kb.loader.declarations import read_objects
from kb.loader.names import Names, Typing
from kb.loader.operators import READABLE
from kb.loader.reader import Expression, Findings, Reader
from kb.loader.tree import Node
from kb.loader.workflow import read_chains
from kb.model.conditions import TRUE, And, Condition, free_variables
from kb.model.domain import Domain, Kind
from kb.model.problem import Problem
from kb.syntax import Parsed
from kb.terms import Atom, Function, is_ground, variables


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
        chains=tuple(read_chains(reader, names)),
        complete=str(reader.root.descend(("complete",)).value) == "true",
        path=reader.root.file.path,
        where=reader.root.where,
    )
    return commanded(problem, reader)


def _facts(reader: Reader, names: Names, section: str, kinds: tuple[Kind, ...]) -> Iterator[Atom]:
    for node in reader.items(section):
        expression = _fact(node) or reader.parse("atoms", node)
        if expression is None:
            continue
        for atom in expression.value:
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
    parsed = (reader.parse("conditions", node) for node in reader.items("goals"))
    parts = tuple(goal_condition(expression, names) for expression in parsed if expression is not None)
    return And(parts) if parts else TRUE


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
