"""Libraries of MACROPs in a database: SQLite in one file, or PostgreSQL by URL. The only doorway to SQLAlchemy."""

from kb.store.documents import document, dumps, loads, macrop_of
from kb.store.library import Figures, Library, Record, Stored, Use
from kb.store.notation import NotationError

__all__ = [
    "Figures",
    "Library",
    "NotationError",
    "Record",
    "Stored",
    "Use",
    "document",
    "dumps",
    "loads",
    "macrop_of",
]
