"""MACROPs and libraries of them, the origin of a plan, and what was prepared, as text and data."""

import dataclasses
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from rich.console import Group, RenderableType
from rich.text import Text

from cellwright.engine.formats.report import rich_parts
from cellwright.engine.formats.report.text_tables import TextTable
from cellwright.engine.model.noun_wording import count_noun
from cellwright.kb.model.domain_model import Domain
from cellwright.kb.model.plan_model import Macrop, MacroStep

if TYPE_CHECKING:
    from cellwright.engine.pipelines.precompute import KeptPoses, KeptSequence, Preparation
    from cellwright.kb.store import Figures, Stored
    from cellwright.kb.store.usage_counts import Utility


def macrop_text(macro: Macrop, domain: Domain | None = None) -> RenderableType:
    """All parts of a MACROP.

    If its domain is given, types that follow from compound terms are left out.
    """
    types = macro.unary_constraints(domain) if domain else macro.types
    parts: list[tuple[str, Iterable[object]]] = [
        ("goals", macro.goals),
        ("workflow", [", ".join(map(str, chain.stages)) for chain in macro.chains]),
        ("preconditions", macro.preconditions),
        ("adders", macro.adders),
        ("unary constraints", types),
        ("n-ary constraints", macro.constraints),
        ("different", macro.disequalities),
        ("excluded", [", ".join(map(str, body)) for body in macro.exclusions]),
        ("resources", macro.resources),
    ]
    rows = [(title, "\n".join(map(str, lines))) for title, lines in parts]
    table = TextTable(
        ("", ""), [(title, cell_text) for title, cell_text in rows if cell_text], lead="bold"
    )
    return Group(
        Text(f"MACROP {macro.name}", style="bold"),
        table,
        Text("plan", style="bold"),
        _macro_steps(macro.steps),
    )


def _macro_steps(steps: Iterable[MacroStep]) -> TextTable:
    rows = [(str(step.id), str(step.operator), ", ".join(map(str, step.after))) for step in steps]
    return TextTable(("step", "operator", "after"), rows)


def library_table(
    stored: "Iterable[Stored]",
    stale: Mapping[int, tuple[str, ...]],
    utilities: "Mapping[tuple[int, str], Utility]",
) -> RenderableType:
    """A library as a table.

    `stale` names the changed parts of the domain; `utilities` says how useful MACROPs were in
    searches.
    """
    numbers = ("no.", "steps", "cost", "uses", "saved s")
    headings = (
        "no.",
        "MACROP",
        *numbers[1:],
        *(("in search",) if utilities else ()),
        *(("stale",) if stale else ()),
    )
    rows = []
    for stored_macro in stored:
        cost = "" if stored_macro.macrop.cost is None else str(stored_macro.macrop.cost)
        cells = [
            str(stored_macro.id),
            str(stored_macro.macrop.name),
            str(len(stored_macro.macrop.steps)),
            cost,
            str(stored_macro.uses),
        ]
        cells.append(f"{stored_macro.saved_s:.2f}")
        cells += [_in_search(stored_macro.id, utilities)] if utilities else []
        rows.append([*cells, *([", ".join(stale.get(stored_macro.id, ()))] if stale else [])])
    return TextTable(headings, rows, right=numbers) if rows else Text("The library is empty.")


def _in_search(number: int, utilities: "Mapping[tuple[int, str], Utility]") -> str:
    """The searches that get a sub-sequence, the share of work left with it, and its uses:
    `forward 0.62, 3/4`.
    """
    mine = {
        search: utility for (own, search), utility in sorted(utilities.items()) if own == number
    }
    offered = {search: utility for search, utility in mine.items() if utility.pays}
    usage_texts = [
        f"{search} {utility.share:.2f}, {utility.used}/{utility.offered}"
        for search, utility in offered.items()
    ]
    return "; ".join(usage_texts) if usage_texts or not mine else "not offered"


def folded_plan(parts: Iterable[Mapping[str, Any]]) -> RenderableType | None:
    """A folded plan: one row for each MACROP, with its steps; None if it contains no MACROPs."""
    rows = []
    for part in parts:
        number = f"{part['macrop']} " if part["macrop"] is not None else ""
        rows.append((f"{number}{part['name']}", part["purpose"], _number_ranges(part["steps"])))
    return TextTable(("MACROP", "for", "steps"), rows) if rows else None


def _number_ranges(numbers: Iterable[int]) -> str:
    """`1..4, 7`."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][-1] + 1:
            runs[-1][1:] = [number]
        else:
            runs.append([number])
    return ", ".join("..".join(map(str, run)) for run in runs)


def library_figures(totals: "Figures", subsequences: int, inner: "Utility") -> RenderableType:
    """The figures of a library.

    `inner` is the sum of the figures of its sub-sequences in searches.
    """
    rows = [
        ("MACROPs", str(totals.macrops)),
        ("goal shapes", str(totals.shapes)),
        ("uses", str(totals.uses)),
    ]
    rows.append(("planning saved", f"{totals.saved_s:.2f} s"))
    if subsequences:
        rows.append(
            ("sub-sequences", f"{subsequences}, used {inner.used} of {inner.offered} times offered")
        )
    rows += [(f"of {name}", str(count)) for name, count in totals.domains.items()]
    return TextTable(("", ""), [*rows, ("schema", str(totals.schema))])


def plan_origin(
    kind: str, number: int | None, name: str, reason: str, listed: bool = False
) -> Text:
    """One sentence about where a plan came from; `listed` is whether its parts are shown above
    it.
    """
    match kind:
        case "library":
            return Text(f"An instance of MACROP {number}, {name}.")
        case "parts":
            whole = (
                f" The whole was learned as MACROP {number}, {name}." if number is not None else ""
            )
            return Text(f"Composed of {'the parts above' if listed else 'MACROPs'}.{whole}")
        case "planner" if number is not None:
            return Text(f"Planned, and learned as MACROP {number}, {name}.")
        case "planner" if reason:
            return Text(f"Planned; not learned: {reason}.")
        case _:
            return Text()


def preparation_content(preparation: "Preparation") -> dict[str, Any]:
    """What was prepared, as data."""
    problems = [
        {
            "problem": problem.problem,
            "status": problem.status,
            "origin": problem.origin,
            "macrop": problem.macrop,
            "name": problem.name,
            "reason": problem.reason,
            "sequence": _kept_sequence_entry(problem.sequence),
            "poses": None if problem.poses is None else dataclasses.asdict(problem.poses),
        }
        for problem in preparation.problems
    ]
    return {
        "problems": problems,
        "stale": {str(number): list(parts) for number, parts in preparation.stale.items()},
    }


def _kept_sequence_entry(kept_sequence: "KeptSequence | None") -> dict[str, Any] | None:
    return (
        None
        if kept_sequence is None
        else {
            "way": kept_sequence.way,
            "left": kept_sequence.left,
            "changes": dict(kept_sequence.changes),
        }
    )


def preparation_text(preparation: "Preparation") -> "RenderableType":
    """What was prepared, as people read it."""
    sequenced = any(problem.sequence for problem in preparation.problems)
    posed, rows = any(problem.poses for problem in preparation.problems), []
    for problem_entry in preparation.problems:
        found_it = problem_entry.status == "found"
        origin_text = (
            plan_origin(
                problem_entry.origin, problem_entry.macrop, problem_entry.name, problem_entry.reason
            ).plain
            if found_it
            else problem_entry.reason
        )
        origin_text = (
            "It follows its sequence."
            if found_it and problem_entry.origin == "sequence"
            else origin_text
        )
        last = [_sequence_said(problem_entry.sequence)] if sequenced else []
        last += [_poses_said(problem_entry.poses)] if posed else []
        rows.append((problem_entry.problem, problem_entry.status, origin_text, *last))
    stale = [
        rich_parts.Text(f"MACROP {n} was stale and is gone: {', '.join(p)} changed")
        for n, p in preparation.stale.items()
    ]
    learned = sum(
        problem.origin == "planner" and problem.macrop is not None
        for problem in preparation.problems
    )
    known_count = sum(problem.origin == "library" for problem in preparation.problems)
    columns = [name for name, shown in (("sequence", sequenced), ("poses", posed)) if shown]
    table = TextTable(("problem", "answer", "", *columns), rows)
    lost = [
        rich_parts.Text(f"{problem.problem}: {name} is out of reach: {why}")
        for problem in preparation.problems
        for name, why in (problem.poses.unreached.items() if problem.poses else ())
    ]
    return rich_parts.Group(
        *stale,
        table,
        *lost,
        rich_parts.Text(
            f"{count_noun(len(preparation.problems), 'problem')}: {learned} learned, "
            f"{known_count} known"
        ),
    )


def _poses_said(kept_poses: "KeptPoses | None") -> str:
    if kept_poses is None:
        return ""
    return f"{kept_poses.reached} reached; {kept_poses.made} found, {kept_poses.kept} kept"


def _sequence_said(kept_sequence: "KeptSequence | None") -> str:
    if kept_sequence is None:
        return ""
    ways = {
        "made": "new",
        "kept": "unchanged",
        "resequenced": "sequenced anew because the kept sequence was stale",
    }
    changes = "".join(
        f", {count} {change_kind}" for change_kind, count in kept_sequence.changes.items()
    )
    return f"{kept_sequence.left} visits, {ways[kept_sequence.way]}{changes}"
