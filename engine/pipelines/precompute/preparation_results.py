"""Problems to prepare, and results of a preparation as a report and its ledger have them."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from cellwright.engine.pipelines.planning.target_files import load_target
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.loader import find_target, problem_files


@dataclass(frozen=True, slots=True)
class KeptSequence:
    """The sequence that is kept for a problem. `left` is the number of visits that are not done.

    `way` is `made`, `kept` (as it was) or `resequenced`. `changes` counts the visits that were
    reordered, moved to another tool, added, dropped or outdated since the last time.
    """

    way: str
    left: int
    changes: Mapping[str, int]


@dataclass(frozen=True, slots=True)
class KeptPoses:
    """What is kept of where the arm can stand for measurements: counts, and the measurements
    out of reach, with the reasons.
    """

    reached: int
    made: int
    kept: int
    unreached: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class PreparedProblem:
    """The result for one problem. `status`: found, infeasible, gave up or bad input.

    `origin`, `macrop`, `name` and `reason` are those of `Answered`; the origin `sequence` is a plan
    that follows the sequence of its measurements. What is not `finished` is done again by the next
    preparation.
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

    `stale` holds the MACROPs that were removed: for each number the parts of the domain that had
    changed.
    """

    problems: tuple[PreparedProblem, ...]
    stale: Mapping[int, tuple[str, ...]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class PreparationJob:
    """What one process needs to plan a problem: the problem's file, the store, and the limits of
    the search.

    `content` is a digest of the files.
    """

    path: Path
    store: str
    expansions: int
    seed: int
    content: str


def is_prepared(prepared: PreparedProblem) -> bool:
    """Whether a problem need not be prepared again."""
    return prepared.finished


def prepared_entry(prepared: PreparedProblem) -> dict[str, Any] | None:
    """A result for the ledger. What is wrong with a file is told anew each time."""
    if prepared.diagnostics:
        return None
    content = dataclasses.asdict(prepared)
    del content["diagnostics"], content["finished"]
    return content


def read_prepared(content: Mapping[str, Any]) -> PreparedProblem:
    """The result that the ledger holds."""
    sequence, poses = content["sequence"], content["poses"]
    rest = {key: value for key, value in content.items() if key not in ("sequence", "poses")}
    return PreparedProblem(
        **rest,
        sequence=None if sequence is None else KeptSequence(**sequence),
        poses=None if poses is None else KeptPoses(**poses),
    )


def problems_of(target: str) -> list[Path]:
    """The problem files that a target names. Raises `InvalidInput` if there are none."""
    folder = Path(target)
    if folder.is_dir() and not (folder / "domain.yaml").exists():
        files = sorted(folder.glob("*.yaml"))
    else:
        path = find_target(target)
        files = [path] if load_target(path).problem is not None else problem_files(path)
    if not files:
        hint = "problems are .yaml files in the folder `problems` beside a domain"
        raise InvalidInput([Diagnostic(Source(target), "K405", "there are no problems here", hint)])
    return files
