"""Reads what a target names before anything is planned: domain, problem, and initial state.

Nothing here needs a planner, so that commands which only look at a cell start quickly.
"""

from pathlib import Path
from typing import TYPE_CHECKING

from cellwright.kb import loader
from cellwright.kb.targets import find_target
from cellwright.kb.terms import Atom

if TYPE_CHECKING:
    from cellwright.kb.loader import Loaded


def load_target(path: Path) -> "Loaded":
    """What is in the file of a domain or problem; the domain may be one that is generated.

    Raises `InvalidInput`.
    """
    from cellwright.engine.pipelines.planning.plan_files import generated_if_bare

    return loader.load(path, generated_if_bare)


def initial_facts(target: str) -> frozenset[Atom]:
    """The initial state of the problem that a target names; empty for a domain, which is not read.

    Raises `InvalidInput`.
    """
    path = find_target(target)
    if loader.domain_of(target) == path:
        return frozenset()
    from cellwright.engine.stages.validation.operator_semantics import Semantics

    problem = load_target(path).problem
    return frozenset() if problem is None else Semantics(problem).initial()
