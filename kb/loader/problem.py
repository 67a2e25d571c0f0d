"""The `Problem` in a problem file, with its domain."""

import dataclasses
from collections.abc import Iterator

from cellwright.kb.diagnostics import unknown_name
from cellwright.kb.loader.command import commanded
from cellwright.kb.loader.declarations import read_objects
from cellwright.kb.loader.inference import Typing, has_arithmetic, scoped
from cellwright.kb.loader.names import READABLE, Names
from cellwright.kb.loader.numeric import with_values
from cellwright.kb.loader.reader import Expression, Findings, Reader
from cellwright.kb.loader.tree import Node
from cellwright.kb.loader.workflow import read_chains
from cellwright.kb.model.bindings import free_variables
from cellwright.kb.model.conditions import TRUE, And, Condition
from cellwright.kb.model.domain import Domain, Kind
from cellwright.kb.model.problem import Problem
from cellwright.kb.model.quantities import misvalued
from cellwright.kb.terms import Atom, Function, Number, is_ground, variables


def read_problem(reader: Reader, domain: Domain, domain_names: Names, findings: Findings) -> Problem:
    """The problem in a file of the right form. Errors in its content are added to `findings`."""
    reader.time_unit = domain.time_unit
    names = dataclasses.replace(domain_names, findings=findings).extended(domain.objects)
    objects = read_objects(reader, names)
    problem = Problem(
        str(reader.root.descend(("problem",)).value),
        domain,
        objects,
        statics=tuple(_facts(reader, names, "statics", (Kind.STATIC,))),
        initial=tuple(_facts(reader, names, "initial", (Kind.FLUENT,))),
        goal=_goal(reader, names),
        chains=tuple(read_chains(reader, names)),
        durations=_durations(reader, domain, names),
        complete=reader.text("complete") == "true",
        path=reader.root.file.path,
        where=reader.root.where,
    )
    if not any(reader.text(key) or reader.items(key) for key in ("goals", "workflow", "command")):
        hint = "add `goals:`, `workflow:` or `command:`"
        findings.add(reader.root.where, "K114", "this problem has no goal", hint, warning=True)
    return commanded(problem, reader)


def _facts(reader: Reader, names: Names, section: str, kinds: tuple[Kind, ...]) -> Iterator[Atom]:
    seen: set[Atom] = set()
    values: dict[Function, int] = {}
    for node in reader.items(section):
        expression = reader.parse("atoms", node)
        if expression is None:
            continue
        for atom in expression.value:
            Typing(names).atom(atom, expression, kinds)
            if not is_ground(atom):
                variable = next(variables(atom))
                message = f"a fact cannot contain the variable {variable}"
                hint = "write one fact for each object; names begin with a small letter"
                names.findings.add(expression.place(variable), "K105", message, hint)
            elif has_arithmetic(atom):
                message = f"the arithmetic in {atom} is not computed here"
                names.findings.add(expression.place(atom), "K107", message, "write the result")
            elif atom in seen:
                message, hint = f"{atom} is listed twice", "leave one out"
                names.findings.add(node.where, "K111", message, hint, warning=True)
            else:
                seen.add(atom)
                _note_value(atom, values, expression, names)
                yield atom


def _note_value(atom: Atom, values: dict[Function, int], expression: Expression, names: Names) -> None:
    """Note the value that a fact gives a quantity. A second one, and one out of range, are reported."""
    bounds = names.quantities.get(atom.name)
    if bounds is None or not atom.arguments or not isinstance(atom.arguments[-1], Number):
        return
    if (wrong := misvalued(atom, bounds, values)) is not None:
        code, message, hint = wrong
        names.findings.add(expression.place(atom), code, message, hint)
    values[Function(atom.name, atom.arguments[:-1])] = atom.arguments[-1].value


def _durations(reader: Reader, domain: Domain, names: Names) -> dict[Function, int]:
    """How long some steps last. Steps of no operator, and lengths below 0, are reported."""
    found: dict[Function, int] = {}
    arity = {each.name: len(each.parameters) for each in domain.operators}
    for _, key, node in reader.entries("durations"):
        parsed = reader.parse("atom", key)
        if parsed is None:
            continue
        step = parsed.value
        if step.name not in arity:
            names.findings.note(unknown_name("operator", step.name, arity, key.where))
        elif len(step.arguments) != arity[step.name] or not is_ground(step):
            hint = f"{step.name} has {arity[step.name]} arguments, and all are names or numbers"
            names.findings.add(key.where, "K102", f"{step} is no step of {step.name}", hint)
        elif int(node.value) < 0:
            names.findings.add(node.where, "K113", "a duration is less than 0", "write a number of 0 or more")
        else:
            found[step] = int(node.value)
    return found


def _goal(reader: Reader, names: Names) -> Condition:
    parts: dict[Condition, Node] = {}
    for node in reader.items("goals"):
        expression = reader.parse("conditions", node)
        if expression is None:
            continue
        goal = goal_condition(expression, names)
        if goal in parts:
            message, hint = f"the goal {node.value.strip()} is listed twice", "leave one out"
            names.findings.add(node.where, "K111", message, hint, warning=True)
        parts.setdefault(goal, node)
    return And(tuple(parts)) if parts else TRUE


def goal_condition(expression: Expression, names: Names) -> Condition:
    """A parsed goal, checked and typed. Its variables and `_` mean "some"."""
    typing = Typing(names)
    expression = scoped(with_values(expression, names), ())
    condition = And(expression.value)
    typing.condition(condition, expression, READABLE)
    for variable in free_variables(condition):
        hint = "write '_' for some value, or `p(X) : q(X)` for all values"
        names.findings.add(
            expression.place(variable), "K105", f"a goal cannot contain the variable {variable}", hint
        )
    return typing.quantified(condition, expression)
