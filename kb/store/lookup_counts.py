"""Counts of which MACROP lookups have paid, read from a library's file without opening the library.

To open a library takes longer than to plan a small problem. So a command that plans once asks here
first, with a few lines of SQL and without SQLAlchemy. Whatever is the matter with the file, the
library tells when it is opened.
"""

import contextlib
import sqlite3
from pathlib import Path

LOOKUP = "(lookup) "  # before the kind of goals, in the table of trials
GRACE = 2  # so many lookups more may fail than pay
UNPAID = "to look such goals up has not paid"


def still_pays(successes: int, failures: int) -> bool:
    """Whether goals of a kind are still looked up, and their plans learned."""
    return failures <= successes + GRACE


def unpaid_kinds(store: str, domain: str) -> frozenset[str]:
    """The kinds of goals of a domain whose lookups have not paid; none if the store is no file, or
    cannot be read.
    """
    if "://" in store:
        return frozenset()
    asked = (
        "SELECT signature, successes, failures FROM trials WHERE domain = ? AND "
        "substr(signature, 1, ?) = ?"
    )
    try:
        file = Path(store).expanduser().absolute()
        if not file.is_file():
            return frozenset()
        with contextlib.closing(
            sqlite3.connect(f"{file.as_uri()}?mode=ro", uri=True)
        ) as connection:
            rows = connection.execute(asked, (domain, len(LOOKUP), LOOKUP)).fetchall()
        return frozenset(
            str(s)[len(LOOKUP) :] for s, paid, failed in rows if not still_pays(paid, failed)
        )
    except (sqlite3.Error, OSError, RuntimeError, ValueError, TypeError):
        return frozenset()
