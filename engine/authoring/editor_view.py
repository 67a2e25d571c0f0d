"""What an editor shows of a domain being written: findings, its files, examples of its names.

Texts that are not saved yet are read in place of their files. `quick` only loads what was edited;
`thorough` checks the whole domain as the command line does.
"""

import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from cellwright.engine.authoring.domain_check import check_domain_files
from cellwright.engine.stages.grounding import ground
from cellwright.kb import loader
from cellwright.kb.asp.excerpt import excerpt_problem
from cellwright.kb.check.fault_base_check import check_faults
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, order_diagnostics
from cellwright.kb.files import is_file, read_unsaved
from cellwright.kb.loader import CELL_FILE, CONTACTS_FILE, load, problem_files
from cellwright.kb.loader.device_uses import read_device
from cellwright.kb.loader.fault_base import FAULTS_FILE, load_faults
from cellwright.kb.model.domain_model import Domain
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.targets import DEVICE_FILE

MAX_ATOMS = 20_000  # of a ground problem in which examples are looked for


@dataclass(frozen=True, slots=True)
class EditorFindings:
    """What was found in a domain. `read` are the absolute paths of the files that were read,
    `complete` says that all were checked.

    `examples` has an instance for names of operators and predicates, `parameters` the types of the
    parameters of operators.
    """

    findings: tuple[Diagnostic, ...]
    read: tuple[str, ...]
    complete: bool = False
    examples: Mapping[str, str] = field(default_factory=dict)
    parameters: Mapping[str, Mapping[str, str]] = field(default_factory=dict)


def quick_findings(
    domain: str, edited: Iterable[str], unsaved: Mapping[str, str]
) -> EditorFindings:
    """The findings in the file of a domain and in those files of it that are edited."""
    findings: list[Diagnostic] = []
    with read_unsaved(unsaved) as desk:
        known_domain = _load_domain(Path(domain), findings)
        for path in dict.fromkeys(edited):
            findings += _of_file(Path(domain), Path(path))
    return EditorFindings(
        order_diagnostics(findings), tuple(desk.read), parameters=_parameter_types(known_domain)
    )


def thorough_findings(
    domain: str, edited: Iterable[str], unsaved: Mapping[str, str]
) -> EditorFindings:
    """The findings of `cellwright check` in a domain, and in edited problems of it that lie
    elsewhere. Reach is not checked.
    """
    if Path(domain).name == DEVICE_FILE:
        return replace(quick_findings(domain, edited, unsaved), complete=True)
    with read_unsaved(unsaved) as desk:
        findings = list(check_domain_files(domain, reach=False).diagnostics)
        for edited_path in edited:
            if os.path.abspath(edited_path) not in desk.read:
                findings += _problem_findings(edited_path)
        known_domain = _load_domain(Path(domain), [])
        problem = next(
            filter(None, (_load_problem(path) for path in _problem_files_of(domain, edited))), None
        )
        examples = _example_names(problem)
    return EditorFindings(
        order_diagnostics(findings),
        tuple(desk.read),
        True,
        examples,
        _parameter_types(known_domain),
    )


def _load_domain(path: Path, findings: list[Diagnostic]) -> Domain | None:
    try:
        if path.name == DEVICE_FILE:  # no domain that is known uses it: its head can be read
            read_device(path.parent)
            return None
        loaded = load(path)
    except InvalidInput as error:
        findings += error.diagnostics
        return None
    findings += loaded.warnings
    return loaded.domain


def _of_file(domain: Path, path: Path) -> list[Diagnostic]:
    """The findings in a file that is not the domain's own."""
    reader, of_device = _READER_OF_FILE.get(path.name), is_file(path.with_name(DEVICE_FILE))
    try:
        if reader is not None and (path.parent == domain.parent or of_device):
            return reader(domain)
        if not of_device and path.suffix in (".yaml", ".yml") and path != domain:
            return list(load(path).warnings)
    except InvalidInput as error:
        return list(error.diagnostics)
    return []


def _fault_findings(domain: Path) -> list[Diagnostic]:
    model, warnings = load_faults(domain)
    return [*warnings, *check_faults(model)]


def _contact_findings(domain: Path) -> list[Diagnostic]:
    return list(loader.load_contacts(domain)[1])


def _cell_findings(domain: Path) -> list[Diagnostic]:
    from cellwright.engine.stages.geometry.reach.cell_check import check_cell

    return list(check_cell(domain.with_name(CELL_FILE), load(domain).domain, None, (), ()))


_READER_OF_FILE: dict[str, Callable[[Path], list[Diagnostic]]] = {
    FAULTS_FILE: _fault_findings,
    CONTACTS_FILE: _contact_findings,
    CELL_FILE: _cell_findings,
}


def _problem_findings(path: str) -> list[Diagnostic]:
    try:
        return list(check_domain_files(path, reach=False).diagnostics)
    except InvalidInput as error:
        return list(error.diagnostics)


def _problem_files_of(domain: str, edited: Iterable[str]) -> list[Path]:
    try:
        return [*map(Path, edited), *problem_files(Path(domain))]
    except InvalidInput:
        return []


def _load_problem(path: Path) -> Problem | None:
    try:
        return load(path).problem
    except InvalidInput:
        return None


def _example_names(problem: Problem | None) -> dict[str, str]:
    """An instance of each operator, predicate and function that a problem knows.

    None if the problem cannot be grounded.
    """
    if problem is None:
        return {}
    try:
        task = ground(excerpt_problem(problem))
    except InvalidInput:
        return {}
    steps = {
        operator.instance.name: str(operator.instance) for operator in reversed(task.operators)
    }
    atoms = {
        atom.name: str(atom)
        for atom in reversed([*task.atoms[:MAX_ATOMS]])
        if atom.name.isidentifier()
    }
    facts = {atom.name: str(atom) for atom in reversed(problem.statics)}
    return {**facts, **atoms, **steps}


def _parameter_types(domain: Domain | None) -> dict[str, dict[str, str]]:
    operators = domain.operators if domain is not None else ()
    return {
        operator.name: {p.variable.name: p.type for p in operator.parameters}
        for operator in operators
    }
