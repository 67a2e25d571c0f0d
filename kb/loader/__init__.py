"""Reads the files of a domain: domains, problems, plans, cells, contact models and fault bases.

What loads domains, problems and plans is imported when it is first asked for. Tasks in PDDL do not
need it, and it is slow to import.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from cellwright.kb.targets import (
    CELL_FILE,
    CONTACTS_FILE,
    DOMAIN_FILE,
    bundled_domains,
    domain_reference,
    find_target,
    problem_files,
)

if TYPE_CHECKING:
    from cellwright.kb.loader.domain_lookup import domain_of
    from cellwright.kb.loader.loading import Loaded, load, load_domain, load_problem, with_goals
    from cellwright.kb.loader.plan import load_plan

__all__ = [
    "CELL_FILE",
    "CONTACTS_FILE",
    "DOMAIN_FILE",
    "Loaded",
    "bundled_domains",
    "domain_of",
    "domain_reference",
    "find_target",
    "load",
    "load_domain",
    "load_plan",
    "load_problem",
    "problem_files",
    "with_goals",
]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(
        import_module(f"cellwright.kb.loader.{'plan' if name == 'load_plan' else 'loading'}"), name
    )
