"""MACROPs for people: one in the form of ITA's figure 4, a library as a table, and the origin of a plan."""

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from rich.console import Group, RenderableType
from rich.text import Text

from cellwright.engine.formats.report.rows import TextTable
from cellwright.kb.model.domain import Domain
from cellwright.kb.model.macro import Macrop, MacroStep

if TYPE_CHECKING:
    from cellwright.kb.store import Figures, Stored
    from cellwright.kb.store.utilities import Utility


def macrop(found: Macrop, domain: Domain | None = None) -> RenderableType:
    """All parts of a MACROP. If its domain is given, types that follow from compound terms are left out."""
    types = found.unary_constraints(domain) if domain else found.types
    parts: list[tuple[str, Iterable[object]]] = [
        ("goals", found.goals),
        ("workflow", [", ".join(map(str, chain.stages)) for chain in found.chains]),
        ("preconditions", found.preconditions),
        ("adders", found.adders),
        ("unary constraints", types),
        ("n-ary constraints", found.constraints),
        ("different", found.disequalities),
        ("excluded", [", ".join(map(str, body)) for body in found.exclusions]),
        ("resources", found.resources),
    ]
    rows = [(title, "\n".join(map(str, lines))) for title, lines in parts]
    table = TextTable(("", ""), [(title, said) for title, said in rows if said], lead="bold")
    return Group(
        Text(f"MACROP {found.name}", style="bold"), table, Text("plan", style="bold"), _steps(found.steps)
    )


def _steps(steps: Iterable[MacroStep]) -> TextTable:
    rows = [(str(step.id), str(step.operator), ", ".join(map(str, step.after))) for step in steps]
    return TextTable(("step", "operator", "after"), rows)


def listing(
    stored: "Iterable[Stored]",
    stale: Mapping[int, tuple[str, ...]],
    utilities: "Mapping[tuple[int, str], Utility]",
) -> RenderableType:
    """A library as a table. `stale` names the changed parts of the domain; `utilities` says how useful MACROPs were in searches."""
    numbers = ("no.", "steps", "cost", "uses", "saved s")
    headings = (
        "no.",
        "MACROP",
        *numbers[1:],
        *(("in search",) if utilities else ()),
        *(("stale",) if stale else ()),
    )
    rows = []
    for each in stored:
        cost = "" if each.macrop.cost is None else str(each.macrop.cost)
        cells = [str(each.id), str(each.macrop.name), str(len(each.macrop.steps)), cost, str(each.uses)]
        cells.append(f"{each.saved_s:.2f}")
        cells += [_in_search(each.id, utilities)] if utilities else []
        rows.append([*cells, *([", ".join(stale.get(each.id, ()))] if stale else [])])
    return TextTable(headings, rows, right=numbers) if rows else Text("The library is empty.")


def _in_search(number: int, utilities: "Mapping[tuple[int, str], Utility]") -> str:
    """The searches that get a sub-sequence, the share of work left with it, and its uses: `forward 0.62, 3/4`."""
    mine = {search: found for (own, search), found in sorted(utilities.items()) if own == number}
    offered = {search: found for search, found in mine.items() if found.pays}
    said = [f"{search} {found.share:.2f}, {found.used}/{found.offered}" for search, found in offered.items()]
    return "; ".join(said) if said or not mine else "not offered"


def folded(parts: Iterable[Mapping[str, Any]]) -> RenderableType | None:
    """A folded plan: one row for each MACROP, with its steps; None if it contains no MACROPs."""
    rows = []
    for part in parts:
        number = f"{part['macrop']} " if part["macrop"] is not None else ""
        rows.append((f"{number}{part['name']}", part["purpose"], _ranges(part["steps"])))
    return TextTable(("MACROP", "for", "steps"), rows) if rows else None


def _ranges(numbers: Iterable[int]) -> str:
    """`1..4, 7`."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][-1] + 1:
            runs[-1][1:] = [number]
        else:
            runs.append([number])
    return ", ".join("..".join(map(str, run)) for run in runs)


def figures(found: "Figures", subsequences: int, inner: "Utility") -> RenderableType:
    """The figures of a library. `inner` is the sum of the figures of its sub-sequences in searches."""
    rows = [("MACROPs", str(found.macrops)), ("goal shapes", str(found.shapes)), ("uses", str(found.uses))]
    rows.append(("planning saved", f"{found.saved_s:.2f} s"))
    if subsequences:
        rows.append(("sub-sequences", f"{subsequences}, used {inner.used} of {inner.offered} times offered"))
    rows += [(f"of {name}", str(count)) for name, count in found.domains.items()]
    return TextTable(("", ""), [*rows, ("schema", str(found.schema))])


def origin(kind: str, number: int | None, name: str, reason: str, listed: bool = False) -> Text:
    """One sentence about where a plan came from; `listed` is whether its parts are shown above it."""
    match kind:
        case "library":
            return Text(f"An instance of MACROP {number}, {name}.")
        case "parts":
            whole = f" The whole was learned as MACROP {number}, {name}." if number is not None else ""
            return Text(f"Composed of {'the parts above' if listed else 'MACROPs'}.{whole}")
        case "planner" if number is not None:
            return Text(f"Planned, and learned as MACROP {number}, {name}.")
        case "planner" if reason:
            return Text(f"Planned; not learned: {reason}.")
        case _:
            return Text()
