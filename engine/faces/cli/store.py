"""`cellwright store`: look after a library, with the cases, sequences and journals in it."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cellwright.engine.faces.cli.answers import Answer, Form, give
from cellwright.engine.faces.cli.declared import Argument, Option
from cellwright.engine.faces.cli.exits import FINDINGS
from cellwright.engine.faces.cli.options import Format, Library

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rich.console import RenderableType

app = typer.Typer(add_completion=False, no_args_is_help=True)


@app.callback()
def store() -> None:
    """Check, back up, restore and move a library, with the closed cases, sequences, poses and journals in it."""


@app.command()
def check(store: Library, format: Format = Form.TEXT) -> None:
    """Look for damage in a library. The library is only read."""
    give(lambda: _check(store), format)


@app.command()
def backup(
    file: Annotated[Path, Argument(help="the file to write: a library in SQLite")],
    store: Library,
    format: Format = Form.TEXT,
) -> None:
    """Copy a library into FILE, also while others use it."""
    give(lambda: _backup(file, store), format)


@app.command()
def restore(
    file: Annotated[Path, Argument(help="a file that `store backup` wrote")],
    store: Library,
    replace: Annotated[
        bool, Option("--replace", help="throw away what the library holds, if it holds anything")
    ] = False,
    format: Format = Form.TEXT,
) -> None:
    """Put the backup FILE into an empty library, in SQLite or PostgreSQL."""
    give(lambda: _restore(file, store, replace), format)


@app.command()
def migrate(
    source: Annotated[
        str, Argument(metavar="SOURCE", help="the library to copy: a file, or a URL as for --store")
    ],
    store: Library,
    format: Format = Form.TEXT,
) -> None:
    """Copy the library SOURCE into an empty one: from SQLite to PostgreSQL, or back. SOURCE stays as it is."""
    give(lambda: _migrate(source, store), format)


def _check(store: str) -> Answer:
    from cellwright.kb.store.checking import checked

    findings, rows = checked(store)
    status, code = ("damaged", FINDINGS) if findings else ("ok", 0)
    said = "" if findings else "no damage found"
    return Answer(status, {"rows": rows}, lambda: _table(rows, said), code, tuple(findings))


def _backup(file: Path, store: str) -> Answer:
    from cellwright.kb.store.copying import back_up

    rows = back_up(store, file)
    return Answer(
        "ok", {"file": str(file), "rows": rows}, lambda: _table(rows, f"written to {file}, and checked")
    )


def _restore(file: Path, store: str, replaces: bool) -> Answer:
    from cellwright.kb.store.copying import restore as restored

    rows = restored(file, store, replaces)
    return Answer("ok", {"rows": rows}, lambda: _table(rows, "restored"))


def _migrate(source: str, store: str) -> Answer:
    from cellwright.kb.store.copying import migrate as copied

    rows = copied(source, store)
    return Answer("ok", {"rows": rows}, lambda: _table(rows, "copied, and checked"))


def _table(rows: "Mapping[str, int]", said: str) -> "RenderableType":
    from rich.console import Group
    from rich.text import Text

    from cellwright.engine.formats.report.rows import TextTable

    table = TextTable(("table", "rows"), [(name, str(count)) for name, count in rows.items()])
    return Group(table, *([Text(said)] if said else []))
