"""What an editor shows of a domain while it is written: findings, the files that belong to it, examples of its names.

Texts that are not saved yet are read in place of their files. `quick` only loads what was edited; `thorough` checks the whole
domain as the command line does.
"""

import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from cellwright.engine.pipelines.checking import check
from cellwright.engine.stages.grounding import ground
from cellwright.kb.asp.excerpt import excerpt
from cellwright.kb.check.faults import check_faults
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, in_order
from cellwright.kb.files import is_file, reading
from cellwright.kb.loader import CELL_FILE, CONTACTS_FILE, load, problem_files
from cellwright.kb.loader.faults import FAULTS_FILE, load_faults
from cellwright.kb.loader.uses import read_device
from cellwright.kb.model.domain import Domain
from cellwright.kb.model.problem import Problem
from cellwright.kb.targets import DEVICE_FILE

MAX_ATOMS = 20_000  # of a ground problem in which examples are looked for


@dataclass(frozen=True, slots=True)
class Seen:
    """What was found in a domain. `read` are the absolute paths of the files that were read, `complete` says that all were checked.

    `examples` has an instance for names of operators and predicates, `parameters` the types of the parameters of operators.
    """

    findings: tuple[Diagnostic, ...]
    read: tuple[str, ...]
    complete: bool = False
    examples: Mapping[str, str] = field(default_factory=dict)
    parameters: Mapping[str, Mapping[str, str]] = field(default_factory=dict)


def quick(domain: str, edited: Iterable[str], unsaved: Mapping[str, str]) -> Seen:
    """The findings in the file of a domain and in those files of it that are edited."""
    found: list[Diagnostic] = []
    with reading(unsaved) as desk:
        known = _domain(Path(domain), found)
        for each in dict.fromkeys(edited):
            found += _of_file(Path(domain), Path(each))
    return Seen(in_order(found), tuple(desk.read), parameters=_parameters(known))


def thorough(domain: str, edited: Iterable[str], unsaved: Mapping[str, str]) -> Seen:
    """The findings of `cellwright check` in a domain, and in edited problems of it that lie elsewhere. Reach is not checked."""
    if Path(domain).name == DEVICE_FILE:
        return replace(quick(domain, edited, unsaved), complete=True)
    with reading(unsaved) as desk:
        found = list(check(domain, reach=False).diagnostics)
        for each in edited:
            if os.path.abspath(each) not in desk.read:
                found += _checked(each)
        known = _domain(Path(domain), [])
        problem = next(filter(None, (_problem(path) for path in _problems(domain, edited))), None)
        examples = _examples(problem)
    return Seen(in_order(found), tuple(desk.read), True, examples, _parameters(known))


def _domain(path: Path, found: list[Diagnostic]) -> Domain | None:
    try:
        if path.name == DEVICE_FILE:  # no domain that is known uses it: its head can be read
            read_device(path.parent)
            return None
        loaded = load(path)
    except InvalidInput as error:
        found += error.diagnostics
        return None
    found += loaded.warnings
    return loaded.domain


def _of_file(domain: Path, path: Path) -> list[Diagnostic]:
    """The findings in a file that is not the domain's own."""
    reader, of_device = _READERS.get(path.name), is_file(path.with_name(DEVICE_FILE))
    try:
        if reader is not None and (path.parent == domain.parent or of_device):
            return reader(domain)
        if not of_device and path.suffix in (".yaml", ".yml") and path != domain:
            return list(load(path).warnings)
    except InvalidInput as error:
        return list(error.diagnostics)
    return []


def _faults(domain: Path) -> list[Diagnostic]:
    model, warnings = load_faults(domain)
    return [*warnings, *check_faults(model)]


def _contacts(domain: Path) -> list[Diagnostic]:
    from cellwright.kb.loader.contacts import load_contacts

    return list(load_contacts(domain)[1])


def _cell(domain: Path) -> list[Diagnostic]:
    from cellwright.engine.stages.geometry.reach.checking import check_cell

    return list(check_cell(domain.with_name(CELL_FILE), load(domain).domain, None, (), ()))


_READERS: dict[str, Callable[[Path], list[Diagnostic]]] = {
    FAULTS_FILE: _faults,
    CONTACTS_FILE: _contacts,
    CELL_FILE: _cell,
}


def _checked(path: str) -> list[Diagnostic]:
    try:
        return list(check(path, reach=False).diagnostics)
    except InvalidInput as error:
        return list(error.diagnostics)


def _problems(domain: str, edited: Iterable[str]) -> list[Path]:
    try:
        return [*map(Path, edited), *problem_files(Path(domain))]
    except InvalidInput:
        return []


def _problem(path: Path) -> Problem | None:
    try:
        return load(path).problem
    except InvalidInput:
        return None


def _examples(problem: Problem | None) -> dict[str, str]:
    """An instance of each operator, predicate and function that a problem knows. None if the problem cannot be grounded."""
    if problem is None:
        return {}
    try:
        task = ground(excerpt(problem))
    except InvalidInput:
        return {}
    steps = {each.instance.name: str(each.instance) for each in reversed(task.operators)}
    atoms = {atom.name: str(atom) for atom in reversed([*task.atoms[:MAX_ATOMS]]) if atom.name.isidentifier()}
    facts = {atom.name: str(atom) for atom in reversed(problem.statics)}
    return {**facts, **atoms, **steps}


def _parameters(domain: Domain | None) -> dict[str, dict[str, str]]:
    operators = domain.operators if domain is not None else ()
    return {each.name: {p.variable.name: p.type for p in each.parameters} for each in operators}
