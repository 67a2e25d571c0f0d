"""Reads the files of a domain: domains, problems, plans, cells, contact models and fault bases.

What loads domains and problems is imported when it is first asked for. Tasks in PDDL do not need it, and it is slow to
import.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from kb.loader.loading import Loaded, load, load_domain, load_problem, problem_files, with_goals
    from kb.loader.plan import load_plan
    from kb.targets import CELL_FILE, CONTACTS_FILE, DOMAIN_FILE, bundled, find, reference

__all__ = [
    "CELL_FILE",
    "CONTACTS_FILE",
    "DOMAIN_FILE",
    "Loaded",
    "bundled",
    "find",
    "load",
    "load_domain",
    "load_plan",
    "load_problem",
    "problem_files",
    "reference",
    "with_goals",
]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from kb.loader import loading

    return getattr(loading, name)
