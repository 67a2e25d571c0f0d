"""What is in the files that a target names, before anything is planned: the domain, the problem, and the state it begins in.

Nothing here needs a planner, so that commands which only look at a cell start quickly.
"""

from pathlib import Path
from typing import TYPE_CHECKING

from cellwright.kb.targets import find
from cellwright.kb.terms import Atom

if TYPE_CHECKING:
    from cellwright.kb.loader import Loaded


def loaded(path: Path) -> "Loaded":
    """What is in the file of a domain or problem; the domain may be one that is generated. Raises `InvalidInput`."""
    from cellwright.engine.pipelines.plan_files import generated_if_bare
    from cellwright.kb.loader import load

    return load(path, generated_if_bare)


def initial_facts(target: str) -> frozenset[Atom]:
    """The initial state of the problem that a target names; empty for a domain, which is not read. Raises `InvalidInput`."""
    from cellwright.kb.loader.references import domain_of

    path = find(target)
    if domain_of(target) == path:
        return frozenset()
    from cellwright.engine.stages.validation.semantics import Semantics

    problem = loaded(path).problem
    return frozenset() if problem is None else Semantics(problem).initial()
