"""Libraries of MACROPs in a database: SQLite in one file, or PostgreSQL by URL. Only this package uses SQLAlchemy.

Each part is imported when it is first asked for: SQLAlchemy is slow to import, and not all parts need it.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cellwright.kb.store.documents import document, dumps, loads, macrop_of
    from cellwright.kb.store.library import Library
    from cellwright.kb.store.notation import NotationError, Requirement
    from cellwright.kb.store.outlines import Outline
    from cellwright.kb.store.records import Figures, Record, Stored, Use

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
    **dict.fromkeys(("document", "dumps", "loads", "macrop_of"), "documents"),
    "Library": "library",
    **dict.fromkeys(("Figures", "Record", "Stored", "Use"), "records"),
    **dict.fromkeys(("NotationError", "Requirement"), "notation"),
    "Outline": "outlines",
}


def __getattr__(name: str) -> Any:
    if name not in _WHERE:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"cellwright.kb.store.{_WHERE[name]}"), name)
