"""The `Domain` in `domain.yaml` and the ASP files that it includes."""

import re
from collections.abc import Callable
from pathlib import Path

from cellwright.kb.commands import check_phrases
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.files import File, is_there
from cellwright.kb.loader.conventions import read_conventions
from cellwright.kb.loader.declarations import read_declarations
from cellwright.kb.loader.deduction import read_deductive_operators, read_defaults
from cellwright.kb.loader.motion import read_motion
from cellwright.kb.loader.names import Names
from cellwright.kb.loader.operators import read_operators
from cellwright.kb.loader.reader import Findings, Reader, require, validate_shape
from cellwright.kb.loader.rules import read_rules
from cellwright.kb.loader.tree import read_file
from cellwright.kb.loader.uses import composed, composed_beside
from cellwright.kb.model.computed import with_named_values
from cellwright.kb.model.domain import TOOLS, Domain, Phrase

Rewrite = Callable[[Path], File | None]


def as_written(_path: Path) -> None:
    """No other text than that of the file."""


def read_domain(path: Path, findings: Findings, rewrite: Rewrite = as_written) -> tuple[Domain, Names]:
    """The domain in a file and its symbol table. `rewrite` may give another text for the file.

    Raises `InvalidInput` if its form is wrong; other errors are noted.
    """
    reader = Reader.of(rewrite(path) or read_file(path), findings)
    composed(reader, path)
    if not validate_shape(reader, "domain"):
        require(findings)
    reader.time_unit = reader.text("units", "time") or "s"
    names = Names(findings)
    read_declarations(reader, names)
    asp, rules = read_rules(reader, names, path.parent)
    motion = read_motion(reader, names)
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
        motion=motion,
        words=_words(reader),
        phrases=tuple(_phrases(reader)),
        path=str(path),
        renamed=read_conventions(reader, names),
        quantities=names.quantities,
        tools=tuple(dict.fromkeys(str(node.value) for node in reader.items("tools"))) or TOOLS,
    )
    for found in check_phrases(domain, reader.place_under("commands")):
        if not names.missing & {*re.findall(r"\w+", found.message)}:  # what follows from a missing type
            findings.note(found)
    return with_named_values(domain), names


def read_beside(domain: Path, name: str, form: str, what: str) -> tuple[Reader, Domain, Names]:
    """A file beside a domain file, read in a form of `cellwright.kb.schema`, with the domain and its names. Raises `InvalidInput`."""
    path = domain.with_name(name)
    if not is_there(path):
        hint = f"write one: `cellwright schema {form}` shows its form"
        raise InvalidInput([Diagnostic(Source(str(path)), "K405", f"this domain has no {what}", hint)])
    known, names = read_domain(domain, Findings())
    reader = Reader.of(read_file(path), Findings())
    composed_beside(reader, domain, form)
    if not validate_shape(reader, form):
        require(reader.findings)
    names.findings = reader.findings
    return reader, known, names


def _words(reader: Reader) -> dict[str, tuple[str, ...]]:
    entries = reader.entries("commands", "words")
    return {key: tuple(str(item.value) for item in node.value) for key, _, node in entries}


def _phrases(reader: Reader) -> list[Phrase]:
    found = []
    for node in reader.items("commands", "phrases"):
        value = {key: str(item.value) for key, (_, item) in node.value.items()}
        if bool(value.get("goal")) == bool(value.get("stage")):
            reader.findings.add(
                node.where, "K005", "a phrase needs either a goal or a stage", "give exactly one of them"
            )
        where = node.value["say"][1].where
        goal, stage, subject = (value.get(key, "") for key in ("goal", "stage", "subject"))
        found.append(Phrase(value["say"], goal, stage, subject, where))
    return found
