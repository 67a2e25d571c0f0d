"""The workflow of a problem file: each entry becomes one chain of stages per binding of its variables."""

import itertools
from collections.abc import Iterator
from dataclasses import replace

from kb.diagnostics import unknown_name
from kb.loader.names import Names, Typing
from kb.loader.reader import Expression, Reader
from kb.model.domain import Kind
from kb.model.problem import Chain
from kb.terms import ANYTHING, Function, Term, Variable, substitute_atom, variables

STAGES = (Kind.EVENT, Kind.FLUENT)


def read_chains(reader: Reader, names: Names) -> Iterator[Chain]:
    """The chains of every entry, in order; `after` names entries that stand before."""
    groups: dict[str, list[str]] = {}
    for index, node in enumerate(reader.items("workflow")):
        title = str(node.value["name"][1].value) if "name" in node.value else str(index + 1)
        after = tuple(_after(reader, names, index, groups))
        chains = list(_entry_chains(reader, names, index, title))
        groups[title] = [chain.name for chain in chains]
        yield from (replace(chain, after=after) for chain in chains)


def _after(reader: Reader, names: Names, index: int, groups: dict[str, list[str]]) -> Iterator[str]:
    for node in reader.items("workflow", index, "after"):
        title = str(node.value)
        if title not in groups:
            names.findings.diagnostics.append(unknown_name("earlier workflow", title, groups, node.where))
        yield from groups.get(title, ())


def _entry_chains(reader: Reader, names: Names, index: int, title: str) -> Iterator[Chain]:
    stages = reader.expression("atoms", "workflow", index, "stages")
    if stages is None:
        return
    choices = _choices(reader, names, index)
    _check(stages, names, set(choices))
    for combination in itertools.product(*choices.values()):
        bindings: dict[Variable, Term] = dict(zip(choices, map(Function, combination), strict=True))
        subject = Function(combination[0]) if combination else _subject(reader, names, index)
        bound = tuple(substitute_atom(atom, bindings) for atom in stages.value)
        for atom in bound:
            Typing(names).atom(atom, stages, STAGES)
        name = f"{title}:{','.join(combination)}" if combination else title
        yield Chain(name, bound, (), subject, stages.node.where)


def _choices(reader: Reader, names: Names, index: int) -> dict[Variable, list[str]]:
    """The objects listed for each variable under `for:`."""
    choices: dict[Variable, list[str]] = {}
    for variable, _, node in reader.entries("workflow", index, "for"):
        listed = reader.names(node)
        for name, where in listed:
            if name not in names.objects:
                names.findings.diagnostics.append(unknown_name("object", name, names.objects, where))
        choices[Variable(variable)] = [name for name, _ in listed]
    return choices


def _check(stages: Expression, names: Names, bound: set[Variable]) -> None:
    typing = Typing(names)
    for atom in stages.value:
        typing.atom(atom, stages, STAGES)
        for variable in variables(atom):
            if variable != ANYTHING and variable not in bound:
                names.findings.add(stages.place(variable), "K105", f"variable {variable} is not under `for:`")
        predicate = names.predicates.get(atom.name)
        if predicate and predicate.kind is Kind.EVENT and ANYTHING in variables(atom):
            names.findings.add(stages.place(atom), "K105", "an event as a stage leaves nothing open")


def _subject(reader: Reader, names: Names, index: int) -> Function | None:
    expression = reader.expression("atom", "workflow", index, "subject")
    if expression is None:
        return None
    subject: Function = expression.value
    if subject.name not in names.objects:
        names.findings.diagnostics.append(
            unknown_name("object", subject.name, names.objects, expression.place())
        )
    return subject
