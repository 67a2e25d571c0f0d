"""The verbs `macros`: what a library has learned, and changes to it."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Argument, Option

from cellwright.engine.faces.cli.options.shared_options import Format, Library
from cellwright.engine.faces.cli.output.answer_output import AnswerForm, VerbAnswer, give_answer
from cellwright.engine.faces.cli.process.exit_codes import FINDINGS
from cellwright.engine.faces.cli.wrong_options import make_misfit
from cellwright.engine.formats import report
from cellwright.engine.formats.report import rich_parts
from cellwright.engine.pipelines import planning
from cellwright.kb import loader
from cellwright.kb import store as kb_store
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source

if TYPE_CHECKING:
    from collections.abc import Mapping

    from cellwright.engine.stages.lifted.domain_digests import DomainDigests
    from cellwright.kb.model.domain_model import Domain
    from cellwright.kb.store import Library as Opened
    from cellwright.kb.store import Stored
    from cellwright.kb.store.usage_counts import Utility

MAX_MACRO_NUMBER = 2**63 - 1  # the largest number that a database can store
DomainOf = Annotated[
    str, Option("--domain", help="only the MACROPs of this domain (a path or a bundled name)")
]

app = typer.Typer(add_completion=False, no_args_is_help=True)


@app.callback()
def macro_group() -> None:
    """Look at a library of learned MACROPs, and change it."""


@app.command("list")
def list_macros(store: Library, domain: DomainOf = "", format: Format = AnswerForm.TEXT) -> None:
    """List the library; with --domain, also show which MACROPs are stale and what has changed."""
    give_answer(lambda: _list_macros(store, domain), format)


@app.command()
def show(
    number: Annotated[int, Argument(max=MAX_MACRO_NUMBER, help="the number of a MACROP")],
    store: Library,
    format: Format = AnswerForm.TEXT,
) -> None:
    """Print one MACROP: goals, preconditions, adders, constraints, resources and body."""
    give_answer(lambda: _show_macro(number, store), format)


@app.command()
def learn(
    files: Annotated[list[Path], Argument(help="plans in JSON")],
    store: Library,
    format: Format = AnswerForm.TEXT,
) -> None:
    """Check the plans in FILES, generalise them and store the MACROPs."""
    give_answer(lambda: _learn_macros(files, store), format)


@app.command()
def forget(
    store: Library,
    numbers: Annotated[
        list[int] | None, Argument(max=MAX_MACRO_NUMBER, help="the numbers of MACROPs")
    ] = None,
    stale: Annotated[str, Option(help="remove the MACROPs that are stale in this domain")] = "",
    format: Format = AnswerForm.TEXT,
) -> None:
    """Remove MACROPs by number, or all MACROPs that are stale in a domain."""
    if not numbers and not stale:
        raise make_misfit("give numbers, or --stale with a domain")
    give_answer(lambda: _forget_macros(numbers or [], stale, store), format)


@app.command("export")
def export_library_macros(
    file: Annotated[Path, Argument(help="the file to write, JSON")],
    store: Library,
    domain: DomainOf = "",
    format: Format = AnswerForm.TEXT,
) -> None:
    """Write the MACROPs of a library to FILE."""
    give_answer(lambda: _export_macros(file, store, domain), format)


@app.command("import")
def import_library_macros(
    file: Annotated[Path, Argument(help="a file that export wrote")],
    store: Library,
    format: Format = AnswerForm.TEXT,
) -> None:
    """Add the MACROPs in FILE to a library."""
    give_answer(lambda: _import_macros(file, store), format)


@app.command()
def stats(store: Library, format: Format = AnswerForm.TEXT) -> None:
    """Print how large a library is, and how much planning time it has saved."""
    give_answer(lambda: _library_stats(store), format)


def _domain_of(target: str) -> "Domain":
    return planning.load_target(loader.find_target(target)).domain


def _domain_digests(target: str) -> "DomainDigests":
    from cellwright.engine.stages.lifted.domain_digests import DomainDigests

    return DomainDigests(_domain_of(target))


def _macro_entry(each: "Stored", stale: tuple[str, ...] = ()) -> dict[str, Any]:
    return {
        "number": each.id,
        "macrop": str(each.macrop.name),
        "domain": each.macrop.domain,
        "goals": [
            *map(str, each.macrop.goals),
            *(str(s) for c in each.macrop.chains for s in c.stages),
        ],
        "steps": len(each.macrop.steps),
        "cost": each.macrop.cost,
        "uses": each.uses,
        "stale": list(stale),
    }


def _list_macros(store: str, target: str) -> VerbAnswer:
    digests = _domain_digests(target) if target else None
    with kb_store.Library(store) as library:
        name = digests.domain.name if digests else ""
        stored_macros = library.all(name)
        stale = library.outdated(name, digests.of) if digests else {}
        utilities = library.utilities(name)
    entries = [
        {
            **_macro_entry(stored_macro, stale.get(stored_macro.id, ())),
            **_in_search(stored_macro.id, utilities),
        }
        for stored_macro in stored_macros
    ]
    return VerbAnswer(
        "ok", {"macrops": entries}, lambda: report.library_table(stored_macros, stale, utilities)
    )


def _in_search(number: int, utilities: "Mapping[tuple[int, str], Utility]") -> dict[str, Any]:
    """How useful a sub-sequence was in searches; empty for other MACROPs."""
    search_figures = {
        search: {**asdict(utility), "pays": utility.pays}
        for (own, search), utility in utilities.items()
        if own == number
    }
    return {"in_search": search_figures} if search_figures else {}


def _show_macro(number: int, store: str) -> VerbAnswer:
    with kb_store.Library(store) as library:
        stored_macro = _macro_numbered(library, number)
    return VerbAnswer(
        "ok",
        {**_macro_entry(stored_macro), "document": kb_store.document(stored_macro.macrop)},
        lambda: report.macrop_text(stored_macro.macrop),
    )


def _macro_numbered(library: "Opened", number: int) -> "Stored":
    stored_macro = library.numbered(number)
    if stored_macro is None:
        message, hint = f"there is no MACROP {number}", "`cellwright macros list` lists the numbers"
        raise InvalidInput([Diagnostic(Source(library.target), "K417", message, hint)])
    return stored_macro


def _learn_macros(files: list[Path], store: str) -> VerbAnswer:
    with kb_store.Library(store) as library:
        lessons = [planning.learn_from_file(file, library) for file in files]
    lesson_lines = [f"{lesson.file}: {lesson}" for lesson in lessons]
    content = {
        "plans": [
            {"file": str(e.file), "macrop": e.macrop, "name": e.name, "reason": e.reason}
            for e in lessons
        ]
    }
    findings = tuple(diagnostic for lesson in lessons for diagnostic in lesson.diagnostics)
    return VerbAnswer(
        "ok",
        content,
        lambda: rich_parts.Text("\n".join(lesson_lines)),
        FINDINGS if findings else 0,
        findings,
    )


def _forget_macros(numbers: list[int], stale: str, store: str) -> VerbAnswer:
    digests = _domain_digests(stale) if stale else None
    with kb_store.Library(store) as library:
        for number in numbers:
            _macro_numbered(library, number)
        outdated = library.outdated(digests.domain.name, digests.of) if digests else {}
        gone = library.forget({*numbers, *outdated})
    content = {"forgotten": gone, "stale": {str(n): list(parts) for n, parts in outdated.items()}}
    return VerbAnswer("ok", content, lambda: rich_parts.Text(f"{gone} forgotten"))


def _export_macros(file: Path, store: str, target: str) -> VerbAnswer:
    with kb_store.Library(store) as library:
        stored_macros = library.all(_domain_of(target).name if target else "")
    planning.write_macros(file, [stored_macro.macrop for stored_macro in stored_macros])
    return VerbAnswer(
        "ok",
        {"file": str(file), "macrops": len(stored_macros)},
        lambda: rich_parts.Text(f"{len(stored_macros)} written to {file}"),
    )


def _import_macros(file: Path, store: str) -> VerbAnswer:
    imported_records = planning.macro_records(planning.read_macros(file))
    with kb_store.Library(store) as library:
        numbers = library.add(imported_records)
    new = sum(number is not None for number in numbers)
    content = {"macrops": len(numbers), "new": new}
    return VerbAnswer(
        "ok", content, lambda: rich_parts.Text(f"{len(numbers)} read, {new} of them new")
    )


def _library_stats(store: str) -> VerbAnswer:
    with kb_store.Library(store) as library:
        library_totals = library.figures()
        utilities = library.utilities()
    kept = len({number for number, _ in utilities})
    inner = sum(utilities.values(), kb_store.Utility())
    figures = {**asdict(library_totals), "saved_s": round(library_totals.saved_s, 3)}
    figures |= {"subsequences": {"macrops": kept, **asdict(inner)}}
    return VerbAnswer("ok", figures, lambda: report.library_figures(library_totals, kept, inner))
