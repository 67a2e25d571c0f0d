"""The workflow of a problem file: for each entry, one chain of stages per binding of its variables."""

import itertools
import re
from collections.abc import Iterator
from dataclasses import replace
from math import prod

from cellwright.kb.diagnostics import unknown_name
from cellwright.kb.loader.inference import Typing
from cellwright.kb.loader.names import Names
from cellwright.kb.loader.reader import Expression, Reader
from cellwright.kb.loader.tree import Node
from cellwright.kb.model.domain import Kind
from cellwright.kb.model.problem import Chain
from cellwright.kb.terms import ANYTHING, Function, Term, Variable, parts_of, substitute_atom, variables

STAGES = (Kind.EVENT, Kind.FLUENT)
MAX_CHAINS = 10_000


def read_chains(reader: Reader, names: Names) -> Iterator[Chain]:
    """The chains of all entries, in order. `after` names earlier entries."""
    groups: dict[str, list[str]] = {}
    for index, node in enumerate(reader.items("workflow")):
        title = reader.text("workflow", index, "name") or str(index + 1)
        if title in groups:
            where = node.descend(("name",)).where
            names.findings.add(
                where, "K104", f"a workflow is called '{title}' already", "choose another name"
            )
        after = tuple(_after(reader, names, index, groups))
        chains = list(_entry_chains(reader, names, index, title))
        groups[title] = [chain.name for chain in chains]
        yield from (replace(chain, after=after) for chain in chains)


def _after(reader: Reader, names: Names, index: int, groups: dict[str, list[str]]) -> Iterator[str]:
    listed = ((str(node.value), node) for node in reader.items("workflow", index, "after"))
    for title, node in reader.once(listed):
        if title not in groups:
            found = unknown_name("earlier workflow", title, groups, node.where)
            names.findings.note(replace(found, hint=found.hint or "name an entry above this one"))
        yield from groups.get(title, ())


def _entry_chains(reader: Reader, names: Names, index: int, title: str) -> Iterator[Chain]:
    stages = reader.expression("stages", "workflow", index, "stages")
    if stages is None:
        return
    choices = _choices(reader, names, index)
    _check(stages, names, set(choices))
    if (count := prod(map(len, choices.values()))) > MAX_CHAINS:
        message = f"this entry makes {count} chains; at most {MAX_CHAINS} are allowed"
        names.findings.add(stages.node.where, "K007", message, "list fewer objects under `for:`")
        return
    for combination in itertools.product(*choices.values()):
        bindings: dict[Variable, Term] = dict(zip(choices, map(Function, combination), strict=True))
        subject = Function(combination[0]) if combination else _subject(reader, names, index)
        bound = tuple(substitute_atom(atom, bindings) for atom in stages.value)
        for atom in (part for stage in bound for part in parts_of(stage)):
            Typing(names).atom(atom, stages, STAGES)
        name = f"{title}:{','.join(combination)}" if combination else title
        yield Chain(name, bound, (), subject, stages.node.where)


def _choices(reader: Reader, names: Names, index: int) -> dict[Variable, list[str]]:
    """The objects listed for each variable under `for:`."""
    choices: dict[Variable, list[str]] = {}
    for variable, key, node in reader.entries("workflow", index, "for"):
        if not re.fullmatch(r"_*[A-Z][A-Za-z0-9_']*", variable):
            hint = "a variable begins with a capital letter, such as P"
            names.findings.add(key.where, "K112", f"'{variable[:60]}' is not a variable", hint)
        listed = list(reader.once(reader.names(node)))
        if not node.value:
            message, hint = f"no object is listed for {variable}", "list some objects, or leave the entry out"
            names.findings.add(key.where, "K114", message, hint)
        choices[Variable(variable)] = [name for name, item in listed if _is_object(name, item, names)]
    return choices


def _is_object(name: str, node: Node, names: Names) -> bool:
    if name not in names.objects:
        names.findings.note(unknown_name("object", name, names.objects, node.where))
    return name in names.objects


def _check(stages: Expression, names: Names, bound: set[Variable]) -> None:
    typing = Typing(names)
    standing = {variable for atom in stages.value for variable in variables(atom)}
    for atom, alone in ((part, part is stage) for stage in stages.value for part in parts_of(stage)):
        typing.atom(atom, stages, STAGES)
        for variable in variables(atom):
            if variable != ANYTHING and variable not in bound:
                hint = f"add a line `for: {{{variable}: [...]}}`, or name the object itself"
                message = f"the variable {variable} is not under `for:`"
                names.findings.add(stages.place(variable), "K105", message, hint)
        predicate = names.predicates.get(atom.name)
        if predicate and predicate.kind is Kind.EVENT and not alone:
            hint = "make the event a stage of its own, before or behind what is to hold"
            message = "an event is no state, so nothing can be reached together with it"
            names.findings.add(stages.place(atom), "K108", message, hint)
        if predicate and predicate.kind is Kind.EVENT and ANYTHING in variables(atom):
            hint = "write every argument of the event"
            names.findings.add(
                stages.place(atom), "K105", "an event that is a stage cannot contain '_'", hint
            )
    for variable in sorted(bound - standing, key=str):
        message, hint = f"no stage names the variable {variable}", "every chain would be the same"
        names.findings.add(stages.node.where, "K110", message, hint, warning=True)


def _subject(reader: Reader, names: Names, index: int) -> Function | None:
    expression = reader.expression("atom", "workflow", index, "subject")
    if expression is None:
        return None
    subject: Function = expression.value
    if subject.name not in names.objects:
        names.findings.note(unknown_name("object", subject.name, names.objects, expression.place()))
    return subject
