"""The `Problem` in a problem file: facts, goals, command in words, and workflow."""

import dataclasses
import itertools
import re
from collections.abc import Collection, Iterator
from dataclasses import replace
from math import prod

from cellwright.kb import commands
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, select_errors, unknown_name
from cellwright.kb.loader.declarations import read_objects
from cellwright.kb.loader.numeric_expressions import with_values
from cellwright.kb.loader.reader import Expression, LoadFindings, Reader
from cellwright.kb.loader.symbol_table import CONDITION_KINDS, SymbolTable
from cellwright.kb.loader.time_windows import TimeReader
from cellwright.kb.loader.variable_types import Typing, has_arithmetic, scope_conditions
from cellwright.kb.loader.yaml_tree import YamlNode
from cellwright.kb.model.condition_forms import free_variables
from cellwright.kb.model.conditions import ALWAYS_TRUE, And, Condition
from cellwright.kb.model.domain_model import Domain, Kind
from cellwright.kb.model.planning_problem import Chain, Problem
from cellwright.kb.model.quantity_fluents import value_error
from cellwright.kb.terms import (
    ANYTHING,
    Atom,
    Function,
    Number,
    Term,
    Variable,
    is_ground,
    stage_parts,
    substitute_atom,
    term_variables,
)


def apply_command(problem: Problem, reader: Reader) -> Problem:
    """The problem with the goal and chains of its `command:`, if it has one.

    Errors are added to the findings.
    """
    node = reader.root.value.get("command", (None, None))[1]
    if node is None or not isinstance(node.value, str) or not node.value:
        return problem
    if reader.items("goals") or reader.items("workflow"):
        hint = "write either a command, or goals and a workflow"
        reader.findings.add(
            node.where, "K005", "a problem cannot have both a command and goals or a workflow", hint
        )
    if select_errors(reader.findings.diagnostics):
        # while the domain or the objects have errors, the words cannot be understood
        return problem
    try:
        return commands.understand_command(problem, node.value, node.place)
    except InvalidInput as error:
        for diagnostic in error.diagnostics:
            reader.findings.note(diagnostic)
        return problem


STAGE_KINDS = (Kind.EVENT, Kind.FLUENT)
MAX_CHAINS = 10_000


def read_chains(reader: Reader, names: SymbolTable) -> Iterator[Chain]:
    """The chains of all entries, in order. `after` names earlier entries."""
    groups: dict[str, list[str]] = {}
    for index, node in enumerate(reader.items("workflow")):
        title = reader.text("workflow", index, "name") or str(index + 1)
        if title in groups:
            where = node.descend(("name",)).where
            names.findings.add(
                where, "K104", f"a workflow is called '{title}' already", "choose another name"
            )
        after = tuple(_earlier_chains(reader, names, index, groups))
        chains = list(_entry_chains(reader, names, index, title))
        groups[title] = [chain.name for chain in chains]
        yield from (replace(chain, after=after) for chain in chains)


def _circle(reader: Reader, title: str, later: str) -> list[str]:
    """The names of entries of which each waits for the next, from `title` over `later` back to
    it; empty if there is no circle.
    """
    waits: dict[str, list[str]] = {}
    for number, _ in enumerate(reader.items("workflow")):
        name = reader.text("workflow", number, "name") or str(number + 1)
        waits[name] = [str(node.value) for node in reader.items("workflow", number, "after")]
    paths, seen = [[title, later]], {later}
    for path in paths:
        for name in waits.get(path[-1], ()):
            if name == title:
                return [*path, title]
            if name not in seen:
                seen.add(name)
                paths.append([*path, name])
    return []


def _unknown_earlier(
    reader: Reader, index: int, title: str, node: YamlNode, known: Collection[str]
) -> Diagnostic:
    """What is wrong with a name under `after:` that no earlier entry has."""
    own = reader.text("workflow", index, "name") or str(index + 1)
    if circle := [own, own] if title == own else _circle(reader, own, title):
        said = f"the workflow '{own}' waits for itself: {' after '.join(circle)}"
        return Diagnostic(node.where, "K101", said, "take one of these names out of `after:`")
    found = unknown_name("earlier workflow", title, known, node.where)
    return replace(found, hint=found.hint or "name an entry above this one")


def _earlier_chains(
    reader: Reader, names: SymbolTable, index: int, groups: dict[str, list[str]]
) -> Iterator[str]:
    listed = ((str(node.value), node) for node in reader.items("workflow", index, "after"))
    for title, node in reader.once(listed):
        if title not in groups:
            names.findings.note(_unknown_earlier(reader, index, title, node, groups))
        yield from groups.get(title, ())


def _entry_chains(reader: Reader, names: SymbolTable, index: int, title: str) -> Iterator[Chain]:
    stages = reader.expression("stages", "workflow", index, "stages")
    if stages is None:
        return
    choices = _variable_choices(reader, names, index)
    _check_stages(stages, names, set(choices))
    if (count := prod(map(len, choices.values()))) > MAX_CHAINS:
        message = f"this entry makes {count} chains; at most {MAX_CHAINS} are allowed"
        names.findings.add(stages.node.where, "K007", message, "list fewer objects under `for:`")
        return
    for combination in itertools.product(*choices.values()):
        bindings: dict[Variable, Term] = dict(zip(choices, map(Function, combination), strict=True))
        subject = Function(combination[0]) if combination else _read_subject(reader, names, index)
        bound = tuple(substitute_atom(atom, bindings) for atom in stages.value)
        for atom in (part for stage in bound for part in stage_parts(stage)):
            Typing(names).atom(atom, stages, STAGE_KINDS)
        name = f"{title}:{','.join(combination)}" if combination else title
        yield Chain(name, bound, (), subject, stages.node.where)


def _variable_choices(reader: Reader, names: SymbolTable, index: int) -> dict[Variable, list[str]]:
    """The objects listed for each variable under `for:`."""
    choices: dict[Variable, list[str]] = {}
    for variable, key, node in reader.entries("workflow", index, "for"):
        if not re.fullmatch(r"_*[A-Z][A-Za-z0-9_']*", variable):
            hint = "a variable begins with a capital letter, such as P"
            names.findings.add(key.where, "K112", f"'{variable[:60]}' is not a variable", hint)
        listed = list(reader.once(reader.names(node)))
        if not node.value:
            message, hint = (
                f"no object is listed for {variable}",
                "list some objects, or leave the entry out",
            )
            names.findings.add(key.where, "K114", message, hint)
        choices[Variable(variable)] = [
            name for name, item in listed if _is_object(name, item, names)
        ]
    return choices


def _is_object(name: str, node: YamlNode, names: SymbolTable) -> bool:
    if name not in names.objects:
        names.findings.note(unknown_name("object", name, names.objects, node.where))
    return name in names.objects


def _check_stages(stages: Expression, names: SymbolTable, bound: set[Variable]) -> None:
    typing = Typing(names)
    standing = {variable for atom in stages.value for variable in term_variables(atom)}
    for atom, alone in (
        (part, part is stage) for stage in stages.value for part in stage_parts(stage)
    ):
        typing.atom(atom, stages, STAGE_KINDS)
        for variable in term_variables(atom):
            if variable != ANYTHING and variable not in bound:
                hint = f"add a line `for: {{{variable}: [...]}}`, or name the object itself"
                message = f"the variable {variable} is not under `for:`"
                names.findings.add(stages.place(variable), "K105", message, hint)
        predicate = names.predicates.get(atom.name)
        if predicate and predicate.kind is Kind.EVENT and not alone:
            hint = "make the event a stage of its own, before or behind what is to hold"
            message = "an event is no state, so nothing can be reached together with it"
            names.findings.add(stages.place(atom), "K108", message, hint)
        if predicate and predicate.kind is Kind.EVENT and ANYTHING in term_variables(atom):
            hint = "write every argument of the event"
            names.findings.add(
                stages.place(atom), "K105", "an event that is a stage cannot contain '_'", hint
            )
    for variable in sorted(bound - standing, key=str):
        message, hint = f"no stage names the variable {variable}", "every chain would be the same"
        names.findings.add(stages.node.where, "K110", message, hint, warning=True)


def _read_subject(reader: Reader, names: SymbolTable, index: int) -> Function | None:
    expression = reader.expression("atom", "workflow", index, "subject")
    if expression is None:
        return None
    subject: Function = expression.value
    if subject.name not in names.objects:
        names.findings.note(unknown_name("object", subject.name, names.objects, expression.place()))
    return subject


def read_problem(
    reader: Reader, domain: Domain, domain_names: SymbolTable, findings: LoadFindings
) -> Problem:
    """The problem in a file of the right form. Errors in its content are added to `findings`."""
    reader.time_unit = domain.time_unit
    names = dataclasses.replace(domain_names, findings=findings).extended(domain.objects)
    objects = read_objects(reader, names)
    times = TimeReader(reader, names, {each.name: each for each in domain.operators})
    problem = Problem(
        str(reader.root.descend(("problem",)).value),
        domain,
        objects,
        statics=tuple(_read_facts(reader, names, "statics", (Kind.STATIC,))),
        initial=tuple(_read_facts(reader, names, "initial", (Kind.FLUENT,))),
        goal=_read_goal(reader, names),
        chains=tuple(read_chains(reader, names)),
        durations=_read_durations(reader, domain, names),
        windows=tuple(times.windows()),
        calendars=tuple(times.calendars()),
        complete=reader.text("complete") == "true",
        path=reader.root.file.path,
        where=reader.root.where,
    )
    if not any(reader.text(key) or reader.items(key) for key in ("goals", "workflow", "command")):
        hint = "add `goals:`, `workflow:` or `command:`"
        findings.add(reader.root.where, "K114", "this problem has no goal", hint, warning=True)
    return apply_command(problem, reader)


def _read_facts(
    reader: Reader, names: SymbolTable, section: str, kinds: tuple[Kind, ...]
) -> Iterator[Atom]:
    seen: set[Atom] = set()
    values: dict[Function, int] = {}
    for node in reader.items(section):
        expression = reader.parse("atoms", node)
        if expression is None:
            continue
        for atom in expression.value:
            Typing(names).atom(atom, expression, kinds)
            if not is_ground(atom):
                variable = next(term_variables(atom))
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


def _note_value(
    atom: Atom, values: dict[Function, int], expression: Expression, names: SymbolTable
) -> None:
    """Note the value that a fact gives a quantity.

    A second one, and one out of range, are reported.
    """
    bounds = names.quantities.get(atom.name)
    if bounds is None or not atom.arguments or not isinstance(atom.arguments[-1], Number):
        return
    if (wrong := value_error(atom, bounds, values)) is not None:
        code, message, hint = wrong
        names.findings.add(expression.place(atom), code, message, hint)
    values[Function(atom.name, atom.arguments[:-1])] = atom.arguments[-1].value


def _read_durations(reader: Reader, domain: Domain, names: SymbolTable) -> dict[Function, int]:
    """How long some steps last. Steps of no operator, and lengths below 0, are reported."""
    durations: dict[Function, int] = {}
    arity = {operator.name: len(operator.parameters) for operator in domain.operators}
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
            names.findings.add(
                node.where, "K113", "a duration is less than 0", "write a number of 0 or more"
            )
        else:
            durations[step] = int(node.value)
    return durations


def _read_goal(reader: Reader, names: SymbolTable) -> Condition:
    parts: dict[Condition, YamlNode] = {}
    for node in reader.items("goals"):
        expression = reader.parse("conditions", node)
        if expression is None:
            continue
        goal = goal_condition(expression, names)
        if goal in parts:
            message, hint = f"the goal {node.value.strip()} is listed twice", "leave one out"
            names.findings.add(node.where, "K111", message, hint, warning=True)
        parts.setdefault(goal, node)
    return And(tuple(parts)) if parts else ALWAYS_TRUE


def goal_condition(expression: Expression, names: SymbolTable) -> Condition:
    """A parsed goal, checked and typed. Its variables and `_` mean "some"."""
    typing = Typing(names)
    expression = scope_conditions(with_values(expression, names), ())
    condition = And(expression.value)
    typing.condition(condition, expression, CONDITION_KINDS)
    for variable in free_variables(condition):
        hint = "write '_' for some value, or `p(X) : q(X)` for all values"
        names.findings.add(
            expression.place(variable),
            "K105",
            f"a goal cannot contain the variable {variable}",
            hint,
        )
    return typing.quantified(condition, expression)
