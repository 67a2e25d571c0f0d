"""What one problem of a preparation needs, and what a preparation gives: what was planned and kept."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from cellwright.kb.diagnostics import Diagnostic


@dataclass(frozen=True, slots=True)
class KeptSequence:
    """The sequence that is kept for a problem. `left` is the number of visits that are not done.

    `way` is `made`, `kept` (as it was) or `resequenced`. `changes` counts the visits that were reordered, moved to another
    tool, added, dropped or outdated since the last time.
    """

    way: str
    left: int
    changes: Mapping[str, int]


@dataclass(frozen=True, slots=True)
class KeptPoses:
    """What is kept of where the arm can stand for measurements: counts, and the measurements out of reach, with the reasons."""

    reached: int
    made: int
    kept: int
    unreached: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class Prepared:
    """The result for one problem. `status`: found, infeasible, gave up or bad input.

    `origin`, `macrop`, `name` and `reason` are those of `Answered`; the origin `sequence` is a plan that follows the sequence of its
    measurements.
    What is not `finished` is done again by the next preparation.
    """

    problem: str
    status: str
    origin: str = ""
    macrop: int | None = None
    name: str = ""
    reason: str = ""
    seconds: float = 0.0
    diagnostics: tuple[Diagnostic, ...] = ()
    sequence: KeptSequence | None = None
    poses: KeptPoses | None = None
    finished: bool = True


@dataclass(frozen=True, slots=True)
class Preparation:
    """The results for a set of problems.

    `stale` holds the MACROPs that were removed: for each number the parts of the domain that had changed.
    """

    problems: tuple[Prepared, ...]
    stale: Mapping[int, tuple[str, ...]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class PreparationJob:
    """What one process needs to plan a problem: the problem's file, the store, and the limits of the search.

    `content` is a digest of the files.
    """

    path: Path
    store: str
    expansions: int
    seed: int
    content: str
