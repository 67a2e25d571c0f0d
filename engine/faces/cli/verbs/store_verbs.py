"""The verbs `store`: check, back up, restore and migrate a library with all that is kept in it."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from typer import Argument, Option

from cellwright.engine.faces.cli.options.shared_options import Format, Library
from cellwright.engine.faces.cli.output.answer_output import AnswerForm, VerbAnswer, give_answer
from cellwright.engine.faces.cli.process.exit_codes import FINDINGS
from cellwright.engine.formats import report
from cellwright.engine.formats.report import rich_parts
from cellwright.kb import store as kb_store

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from rich.console import RenderableType

    from cellwright.kb.store.journal import JournalProof
    from cellwright.kb.store.store_maintenance import VerifiedJournal

app = typer.Typer(add_completion=False, no_args_is_help=True)


@app.callback()
def store_group() -> None:
    """Check, back up, restore and move a library, with the closed cases, sequences, poses and
    journals in it.
    """


@app.command()
def check(store: Library, format: Format = AnswerForm.TEXT) -> None:
    """Look for damage in a library. The library is only read."""
    give_answer(lambda: _check_store(store), format)


@app.command()
def verify(store: Library, format: Format = AnswerForm.TEXT) -> None:
    """Prove that no journal was changed since it was written, and tell who began which run.

    With CELLWRIGHT_KEY, each must have been sealed with that key.
    """
    give_answer(lambda: _verify_store(store), format)


@app.command()
def backup(
    file: Annotated[Path, Argument(help="the file to write: a library in SQLite")],
    store: Library,
    format: Format = AnswerForm.TEXT,
) -> None:
    """Copy a library into FILE, also while others use it."""
    give_answer(lambda: _backup_store(file, store), format)


@app.command()
def restore(
    file: Annotated[Path, Argument(help="a file that `store_group backup` wrote")],
    store: Library,
    replace: Annotated[
        bool, Option("--replace", help="throw away what the library holds, if it holds anything")
    ] = False,
    format: Format = AnswerForm.TEXT,
) -> None:
    """Put the backup FILE into an empty library, in SQLite or PostgreSQL."""
    give_answer(lambda: _restore_store(file, store, replace), format)


@app.command()
def migrate(
    source: Annotated[
        str,
        Argument(
            metavar="SOURCE", help="the library to copy: a file, or a URL as for --store_group"
        ),
    ],
    store: Library,
    format: Format = AnswerForm.TEXT,
) -> None:
    """Copy the library SOURCE into an empty one: from SQLite to PostgreSQL, or back.

    SOURCE stays as it is.
    """
    give_answer(lambda: _migrate_store(source, store), format)


def _check_store(store: str) -> VerbAnswer:
    findings, rows = kb_store.check_library(store)
    status, code = ("damaged", FINDINGS) if findings else ("ok", 0)
    summary_line = "" if findings else "no damage found"
    return VerbAnswer(
        status, {"rows": rows}, lambda: _row_counts(rows, summary_line), code, tuple(findings)
    )


def _verify_store(store: str) -> VerbAnswer:
    verified = kb_store.verify_journals(store)
    damaged = any(journal.proof.findings for journal in verified)
    entries = [
        {
            "run": journal.run,
            "begun": journal.begun,
            "account": journal.account,
            "lines": journal.proof.lines,
            "chained": journal.proof.chained,
            "sealed": journal.proof.sealed,
            "findings": list(journal.proof.findings),
        }
        for journal in verified
    ]
    status, code = ("damaged", FINDINGS) if damaged else ("ok", 0)
    return VerbAnswer(status, {"journals": entries}, lambda: _journal_proofs(verified), code)


def _journal_proofs(verified: "Sequence[VerifiedJournal]") -> "RenderableType":
    rows = [
        (
            journal.run,
            journal.begun,
            journal.account,
            str(journal.proof.lines),
            _proof_text(journal.proof),
        )
        for journal in verified
    ]
    return report.TextTable(("run", "begun", "by", "lines", "since then"), rows)


def _proof_text(proof: "JournalProof") -> str:
    if proof.findings:
        return "; ".join(proof.findings)
    if not proof.chained:
        return "no digests: only the numbers of its lines are checked"
    return "unchanged, sealed by the site's key" if proof.sealed else "unchanged"


def _backup_store(file: Path, store: str) -> VerbAnswer:
    rows = kb_store.write_backup(store, file)
    return VerbAnswer(
        "ok",
        {"file": str(file), "rows": rows},
        lambda: _row_counts(rows, f"written to {file}, and checked"),
    )


def _restore_store(file: Path, store: str, replaces: bool) -> VerbAnswer:
    rows = kb_store.restore_backup(file, store, replaces)
    return VerbAnswer("ok", {"rows": rows}, lambda: _row_counts(rows, "restored"))


def _migrate_store(source: str, store: str) -> VerbAnswer:
    rows = kb_store.migrate_library(source, store)
    return VerbAnswer("ok", {"rows": rows}, lambda: _row_counts(rows, "copied, and checked"))


def _row_counts(rows: "Mapping[str, int]", said: str) -> "RenderableType":
    table = report.TextTable(
        ("table", "rows"), [(name, str(count)) for name, count in rows.items()]
    )
    return rich_parts.Group(table, *([rich_parts.Text(said)] if said else []))
