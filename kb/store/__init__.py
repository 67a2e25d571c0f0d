"""Libraries of MACROPs in a database: SQLite in one file, or PostgreSQL by URL. Only this package
uses SQLAlchemy.
"""

from typing import TYPE_CHECKING

from cellwright.kb.doorways import open_doorway

if TYPE_CHECKING:
    from cellwright.kb.store.case_store import Cases as Cases
    from cellwright.kb.store.database import opened_so_far as opened_so_far
    from cellwright.kb.store.default_path import default_store as default_store
    from cellwright.kb.store.journal import Journal as Journal
    from cellwright.kb.store.lookup_counts import UNPAID as UNPAID
    from cellwright.kb.store.lookup_counts import unpaid_kinds as unpaid_kinds
    from cellwright.kb.store.macrop_documents import Figures as Figures
    from cellwright.kb.store.macrop_documents import Record as Record
    from cellwright.kb.store.macrop_documents import Stored as Stored
    from cellwright.kb.store.macrop_documents import Use as Use
    from cellwright.kb.store.macrop_documents import document as document
    from cellwright.kb.store.macrop_documents import dumps as dumps
    from cellwright.kb.store.macrop_documents import loads as loads
    from cellwright.kb.store.macrop_documents import macrop_of as macrop_of
    from cellwright.kb.store.macrop_library import Library as Library
    from cellwright.kb.store.macrop_outlines import Outline as Outline
    from cellwright.kb.store.store_maintenance import check_library as check_library
    from cellwright.kb.store.store_maintenance import migrate_library as migrate_library
    from cellwright.kb.store.store_maintenance import restore_backup as restore_backup
    from cellwright.kb.store.store_maintenance import store_damage as store_damage
    from cellwright.kb.store.store_maintenance import verify_journals as verify_journals
    from cellwright.kb.store.store_maintenance import write_backup as write_backup
    from cellwright.kb.store.term_notation import NotationError as NotationError
    from cellwright.kb.store.term_notation import Requirement as Requirement
    from cellwright.kb.store.unit_ledger import UnitStore as UnitStore
    from cellwright.kb.store.usage_counts import Utility as Utility
else:
    __getattr__ = open_doorway(
        __name__,
        {
            ".case_store": ("Cases",),
            ".database": ("opened_so_far",),
            ".default_path": ("default_store",),
            ".journal": ("Journal",),
            ".lookup_counts": (
                "UNPAID",
                "unpaid_kinds",
            ),
            ".macrop_documents": (
                "Figures",
                "Record",
                "Stored",
                "Use",
                "document",
                "dumps",
                "loads",
                "macrop_of",
            ),
            ".macrop_library": ("Library",),
            ".macrop_outlines": ("Outline",),
            ".store_maintenance": (
                "check_library",
                "migrate_library",
                "restore_backup",
                "store_damage",
                "verify_journals",
                "write_backup",
            ),
            ".term_notation": (
                "NotationError",
                "Requirement",
            ),
            ".unit_ledger": ("UnitStore",),
            ".usage_counts": ("Utility",),
        },
    )
