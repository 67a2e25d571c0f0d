"""What is in the files that a target names, before anything is planned: the domain, the problem, and the state it begins in.

Nothing here needs a planner, so that commands which only look at a cell start quickly.
"""

import re
from pathlib import Path
from typing import TYPE_CHECKING

from engine.stages.validation.semantics import Semantics
from kb.files import File, read_file
from kb.targets import CONTACTS_FILE, find
from kb.terms import Atom

if TYPE_CHECKING:
    from kb.loader import Loaded

OPERATORS = re.compile(r"^(operators|['\"]operators['\"])\s*:", re.MULTILINE)


def loaded(path: Path) -> "Loaded":
    """What is in the file of a domain or problem; the domain may be one that is generated. Raises `InvalidInput`."""
    from kb.loader import load

    return load(path, generated_if_bare)


def generated_if_bare(domain: Path) -> File | None:
    """The generated domain for a domain file without operators that has a contact model beside it, else None."""
    if not domain.with_name(CONTACTS_FILE).is_file() or OPERATORS.search(read_file(domain).text):
        return None
    from engine.pipelines.task_space import generated  # slow to import

    return generated(domain)


def initial_facts(target: str) -> frozenset[Atom]:
    """The initial state of the problem that a target names; empty for a domain. Raises `InvalidInput`."""
    problem = loaded(find(target)).problem
    return frozenset() if problem is None else Semantics(problem).initial()
