"""Libraries of MACROPs in a database: SQLite in one file, or PostgreSQL by URL. Only this package uses SQLAlchemy."""

from kb.store.documents import document, dumps, loads, macrop_of
from kb.store.library import Figures, Library, Record, Stored, Use
from kb.store.notation import NotationError
from kb.store.outlines import Outline, Requirement

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
