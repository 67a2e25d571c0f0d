"""Libraries of MACROPs in a database: SQLite in one file, or PostgreSQL by URL. Only this package
uses SQLAlchemy.

Each part is imported when it is first asked for: SQLAlchemy is slow to import, and not all parts
need it.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cellwright.kb.store.macrop_documents import (
        Figures,
        Record,
        Stored,
        Use,
        document,
        dumps,
        loads,
        macrop_of,
    )
    from cellwright.kb.store.macrop_library import Library
    from cellwright.kb.store.macrop_outlines import Outline
    from cellwright.kb.store.term_notation import NotationError, Requirement

__all__ = [
    "Figures",
    "Library",
    "NotationError",
    "Outline",
    "Record",
    "Requirement",
    "Stored",
    "Use",
    "document",
    "dumps",
    "loads",
    "macrop_of",
]

_WHERE = {
    **dict.fromkeys(("document", "dumps", "loads", "macrop_of"), "macrop_documents"),
    "Library": "macrop_library",
    **dict.fromkeys(("Figures", "Record", "Stored", "Use"), "macrop_documents"),
    **dict.fromkeys(("NotationError", "Requirement"), "term_notation"),
    "Outline": "macrop_outlines",
}


def __getattr__(name: str) -> Any:
    if name not in _WHERE:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"cellwright.kb.store.{_WHERE[name]}"), name)
