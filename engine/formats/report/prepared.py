"""What was prepared: plans learned or known, sequences and poses kept."""

import dataclasses
from typing import TYPE_CHECKING, Any

from cellwright.engine.model.wording import counted

if TYPE_CHECKING:
    from rich.console import RenderableType

    from cellwright.engine.pipelines.preparation import KeptPoses, KeptSequence, Preparation


def content(found: "Preparation") -> dict[str, Any]:
    """What was prepared, as data."""
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


def text(found: "Preparation") -> "RenderableType":
    """What was prepared, as people read it."""
    from rich.console import Group
    from rich.text import Text

    from cellwright.engine.formats.report.macros import origin
    from cellwright.engine.formats.report.rows import TextTable

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
