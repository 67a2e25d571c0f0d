"""`cellwright macros`: what a library has learned."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cellwright.engine.faces.cli.answers import Answer, Form, give
from cellwright.engine.faces.cli.declared import Argument, Option, misfit
from cellwright.engine.faces.cli.exits import FINDINGS
from cellwright.engine.faces.cli.options import Format, Library

if TYPE_CHECKING:
    from collections.abc import Mapping

    from cellwright.engine.stages.macros.lifted.digests import Digests
    from cellwright.kb.model.domain import Domain
    from cellwright.kb.store import Library as Opened
    from cellwright.kb.store import Stored
    from cellwright.kb.store.utilities import Utility

LARGEST = 2**63 - 1  # the largest number that a database can store
DomainOf = Annotated[
    str, Option("--domain", help="only the MACROPs of this domain (a path or a bundled name)")
]

app = typer.Typer(add_completion=False, no_args_is_help=True)


@app.callback()
def macros() -> None:
    """Look at a library of learned MACROPs, and change it."""


@app.command("list")
def list_(store: Library, domain: DomainOf = "", format: Format = Form.TEXT) -> None:
    """List the library; with --domain, also show which MACROPs are stale and what has changed."""
    give(lambda: _list(store, domain), format)


@app.command()
def show(
    number: Annotated[int, Argument(max=LARGEST, help="the number of a MACROP")],
    store: Library,
    format: Format = Form.TEXT,
) -> None:
    """Print one MACROP: goals, preconditions, adders, constraints, resources and body."""
    give(lambda: _show(number, store), format)


@app.command()
def learn(
    files: Annotated[list[Path], Argument(help="plans in JSON")],
    store: Library,
    format: Format = Form.TEXT,
) -> None:
    """Check the plans in FILES, generalise them and store the MACROPs."""
    give(lambda: _learn(files, store), format)


@app.command()
def forget(
    store: Library,
    numbers: Annotated[list[int] | None, Argument(max=LARGEST, help="the numbers of MACROPs")] = None,
    stale: Annotated[str, Option(help="remove the MACROPs that are stale in this domain")] = "",
    format: Format = Form.TEXT,
) -> None:
    """Remove MACROPs by number, or all MACROPs that are stale in a domain."""
    if not numbers and not stale:
        raise misfit("give numbers, or --stale with a domain")
    give(lambda: _forget(numbers or [], stale, store), format)


@app.command("export")
def export_(
    file: Annotated[Path, Argument(help="the file to write, JSON")],
    store: Library,
    domain: DomainOf = "",
    format: Format = Form.TEXT,
) -> None:
    """Write the MACROPs of a library to FILE."""
    give(lambda: _export(file, store, domain), format)


@app.command("import")
def import_(
    file: Annotated[Path, Argument(help="a file that export wrote")],
    store: Library,
    format: Format = Form.TEXT,
) -> None:
    """Add the MACROPs in FILE to a library."""
    give(lambda: _import(file, store), format)


@app.command()
def stats(store: Library, format: Format = Form.TEXT) -> None:
    """Print how large a library is, and how much planning time it has saved."""
    give(lambda: _stats(store), format)


def _domain(target: str) -> "Domain":
    from cellwright.engine.pipelines.planning import loaded
    from cellwright.kb.loader import find

    return loaded(find(target)).domain


def _digests(target: str) -> "Digests":
    from cellwright.engine.stages.macros.lifted.digests import Digests

    return Digests(_domain(target))


def _entry(each: "Stored", stale: tuple[str, ...] = ()) -> dict[str, Any]:
    return {
        "number": each.id,
        "macrop": str(each.macrop.name),
        "domain": each.macrop.domain,
        "goals": [*map(str, each.macrop.goals), *(str(s) for c in each.macrop.chains for s in c.stages)],
        "steps": len(each.macrop.steps),
        "cost": each.macrop.cost,
        "uses": each.uses,
        "stale": list(stale),
    }


def _list(store: str, target: str) -> Answer:
    from cellwright.engine.formats.report import macros as report
    from cellwright.kb.store import Library

    digests = _digests(target) if target else None
    with Library(store) as library:
        name = digests.domain.name if digests else ""
        found = library.all(name)
        stale = library.outdated(name, digests.of) if digests else {}
        utilities = library.utilities(name)
    entries = [{**_entry(each, stale.get(each.id, ())), **_in_search(each.id, utilities)} for each in found]
    return Answer("ok", {"macrops": entries}, lambda: report.listing(found, stale, utilities))


def _in_search(number: int, utilities: "Mapping[tuple[int, str], Utility]") -> dict[str, Any]:
    """How useful a sub-sequence was in searches; empty for other MACROPs."""
    from dataclasses import asdict

    found = {
        search: {**asdict(each), "pays": each.pays}
        for (own, search), each in utilities.items()
        if own == number
    }
    return {"in_search": found} if found else {}


def _show(number: int, store: str) -> Answer:
    from cellwright.engine.formats.report import macros as report
    from cellwright.kb.store import Library, document

    with Library(store) as library:
        found = _numbered(library, number)
    return Answer(
        "ok", {**_entry(found), "document": document(found.macrop)}, lambda: report.macrop(found.macrop)
    )


def _numbered(library: "Opened", number: int) -> "Stored":
    from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source

    found = library.numbered(number)
    if found is None:
        message, hint = f"there is no MACROP {number}", "`cellwright macros list` lists the numbers"
        raise InvalidInput([Diagnostic(Source(library.target), "K417", message, hint)])
    return found


def _learn(files: list[Path], store: str) -> Answer:
    from rich.text import Text

    from cellwright.engine.pipelines.reuse.lessons import lesson
    from cellwright.kb.store import Library

    with Library(store) as library:
        lessons = [lesson(file, library) for file in files]
    said = [f"{each.file}: {each}" for each in lessons]
    content = {
        "plans": [
            {"file": str(e.file), "macrop": e.macrop, "name": e.name, "reason": e.reason} for e in lessons
        ]
    }
    findings = tuple(found for each in lessons for found in each.diagnostics)
    return Answer("ok", content, lambda: Text("\n".join(said)), FINDINGS if findings else 0, findings)


def _forget(numbers: list[int], stale: str, store: str) -> Answer:
    from rich.text import Text

    from cellwright.kb.store import Library

    digests = _digests(stale) if stale else None
    with Library(store) as library:
        for number in numbers:
            _numbered(library, number)
        outdated = library.outdated(digests.domain.name, digests.of) if digests else {}
        gone = library.forget({*numbers, *outdated})
    content = {"forgotten": gone, "stale": {str(n): list(parts) for n, parts in outdated.items()}}
    return Answer("ok", content, lambda: Text(f"{gone} forgotten"))


def _export(file: Path, store: str, target: str) -> Answer:
    from rich.text import Text

    from cellwright.engine.pipelines.reuse.lessons import write
    from cellwright.kb.store import Library

    with Library(store) as library:
        found = library.all(_domain(target).name if target else "")
    write(file, [each.macrop for each in found])
    return Answer(
        "ok", {"file": str(file), "macrops": len(found)}, lambda: Text(f"{len(found)} written to {file}")
    )


def _import(file: Path, store: str) -> Answer:
    from rich.text import Text

    from cellwright.engine.pipelines.reuse.lessons import read, records
    from cellwright.kb.store import Library

    made = records(read(file))
    with Library(store) as library:
        numbers = library.add(made)
    new = sum(number is not None for number in numbers)
    content = {"macrops": len(numbers), "new": new}
    return Answer("ok", content, lambda: Text(f"{len(numbers)} read, {new} of them new"))


def _stats(store: str) -> Answer:
    from dataclasses import asdict

    from cellwright.engine.formats.report import macros as report
    from cellwright.kb.store import Library
    from cellwright.kb.store.utilities import Utility

    with Library(store) as library:
        found = library.figures()
        utilities = library.utilities()
    kept = len({number for number, _ in utilities})
    inner = sum(utilities.values(), Utility())
    figures = {**asdict(found), "saved_s": round(found.saved_s, 3)}
    figures |= {"subsequences": {"macrops": kept, **asdict(inner)}}
    return Answer("ok", figures, lambda: report.figures(found, kept, inner))
