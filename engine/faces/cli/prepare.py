"""`cellwright prepare`: plan a set of problems before the plans are needed."""

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from engine.faces.cli.answers import Answer, Form, give
from engine.faces.cli.exits import BAD_INPUT, GAVE_UP, INTERRUPTED, LIMIT
from engine.faces.cli.options import Cluster, Expansions, Format, Jobs, Library, Seed, TimeLimit
from engine.faces.cli.working import crew_asked, progress_of, refuse_both
from engine.model.wording import counted

if TYPE_CHECKING:
    from rich.console import RenderableType

    from engine.pipelines.preparation import KeptPoses, KeptSequence, Preparation
    from engine.pipelines.units import Crew


def prepare(
    target: Annotated[
        str, typer.Argument(help="a domain (all its problems), a folder of problems, or one problem")
    ],
    store: Library,
    jobs: Jobs = 0,
    cluster: Cluster = "",
    time_limit: TimeLimit = None,
    expansions: Expansions = 1_000_000,
    seed: Seed = 0,
    format: Format = Form.TEXT,
) -> None:
    """Plan every problem of TARGET, sequence its measurements, and fill the store before plans are needed."""
    refuse_both(jobs, cluster)
    give(
        lambda: _prepare(target, store, crew_asked(jobs, cluster), time_limit, expansions, seed),
        format,
    )


def _prepare(
    target: str, store: str, crew: "Crew", seconds: float | None, expansions: int, seed: int
) -> Answer:
    from engine.faces.cli.interruption import Interruption
    from engine.pipelines.preparation import prepare as prepare_all
    from engine.stages.planning import Limits

    paths = _problems(target)
    with Interruption(seconds) as interrupted, progress_of("planning") as progress:
        limits = Limits(expansions, interrupted=interrupted, seed=seed)
        found = prepare_all(paths, store, limits, crew, progress)
    statuses = {each.status for each in found.problems}
    code = INTERRUPTED if interrupted.heard else BAD_INPUT if "bad input" in statuses else 0
    if not code and ("gave up" in statuses or len(found.problems) < len(paths)):
        code = LIMIT if interrupted() else GAVE_UP
    diagnostics = tuple(dict.fromkeys(d for each in found.problems for d in each.diagnostics))
    return Answer(
        "ok" if not code else "incomplete", _content(found), lambda: _text(found), code, diagnostics
    )


def _problems(target: str) -> list[Path]:
    """The problem files that a target names. Raises `InvalidInput` if there are none."""
    from engine.pipelines.planning import loaded
    from kb.diagnostics import Diagnostic, InvalidInput, Source
    from kb.loader import find, problem_files

    folder = Path(target)
    if folder.is_dir() and not (folder / "domain.yaml").exists():
        found = sorted(folder.glob("*.yaml"))
    else:
        path = find(target)
        found = [path] if loaded(path).problem is not None else problem_files(path)
    if not found:
        hint = "problems are .yaml files in the folder `problems` beside a domain"
        raise InvalidInput([Diagnostic(Source(target), "K405", "there are no problems here", hint)])
    return found


def _content(found: "Preparation") -> dict[str, Any]:
    problems = [
        {
            "problem": each.problem,
            "status": each.status,
            "origin": each.origin,
            "macrop": each.macrop,
            "name": each.name,
            "reason": each.reason,
            "sequence": _sequence(each.sequence),
            "poses": None if each.poses is None else dataclasses.asdict(each.poses),
        }
        for each in found.problems
    ]
    return {
        "problems": problems,
        "stale": {str(number): list(parts) for number, parts in found.stale.items()},
    }


def _sequence(kept: "KeptSequence | None") -> dict[str, Any] | None:
    return None if kept is None else {"way": kept.way, "left": kept.left, "changes": dict(kept.changes)}


def _text(found: "Preparation") -> "RenderableType":
    from rich.console import Group
    from rich.text import Text

    from engine.formats.report.macros import origin
    from engine.formats.report.rows import TextTable

    sequenced = any(each.sequence for each in found.problems)
    posed, rows = any(each.poses for each in found.problems), []
    for each in found.problems:
        found_it = each.status == "found"
        said = origin(each.origin, each.macrop, each.name, each.reason).plain if found_it else each.reason
        said = "It follows its sequence." if found_it and each.origin == "sequence" else said
        last = [_sequence_said(each.sequence)] if sequenced else []
        last += [_poses_said(each.poses)] if posed else []
        rows.append((each.problem, each.status, said, *last))
    stale = [
        Text(f"MACROP {n} was stale and is gone: {', '.join(p)} changed") for n, p in found.stale.items()
    ]
    learned = sum(each.origin == "planner" and each.macrop is not None for each in found.problems)
    known = sum(each.origin == "library" for each in found.problems)
    columns = [name for name, shown in (("sequence", sequenced), ("poses", posed)) if shown]
    table = TextTable(("problem", "answer", "", *columns), rows)
    lost = [
        Text(f"{each.problem}: {name} is out of reach: {why}")
        for each in found.problems
        for name, why in (each.poses.unreached.items() if each.poses else ())
    ]
    return Group(
        *stale,
        table,
        *lost,
        Text(f"{counted(len(found.problems), 'problem')}: {learned} learned, {known} known"),
    )


def _poses_said(kept: "KeptPoses | None") -> str:
    if kept is None:
        return ""
    return f"{kept.reached} reached; {kept.made} found, {kept.kept} kept"


def _sequence_said(kept: "KeptSequence | None") -> str:
    if kept is None:
        return ""
    ways = {
        "made": "new",
        "kept": "unchanged",
        "resequenced": "sequenced anew because the kept sequence was stale",
    }
    changes = "".join(f", {count} {what}" for what, count in kept.changes.items())
    return f"{kept.left} visits, {ways[kept.way]}{changes}"
