"""MACROPs for people: one as ITA's figure 4 draws it, a library as a table, and where a plan came from."""

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from kb.model.domain import Domain
from kb.model.macro import Macrop, MacroStep

if TYPE_CHECKING:
    from kb.store import Figures, Stored


def macrop(found: Macrop, domain: Domain | None = None) -> RenderableType:
    """All parts of a MACROP. With its domain, types that compound terms state anyway are left out."""
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
    table = Table(box=None, show_header=False, padding=(0, 2, 0, 0))
    table.add_column(style="bold", no_wrap=True)
    table.add_column(overflow="fold")
    for title, lines in parts:
        said = list(map(str, lines))
        if said:
            table.add_row(title, Text("\n".join(said)))
    return Group(
        Text(f"MACROP {found.name}", style="bold"), table, Text("plan", style="bold"), _steps(found.steps)
    )


def _steps(steps: Iterable[MacroStep]) -> Table:
    table = Table(box=None, padding=(0, 2, 0, 0))
    for title in ("step", "operator", "after"):
        table.add_column(title, overflow="fold")
    for step in steps:
        table.add_row(str(step.id), str(step.operator), ", ".join(map(str, step.after)))
    return table


def listing(stored: "Iterable[Stored]", stale: Mapping[int, tuple[str, ...]]) -> RenderableType:
    """A library as a table; `stale` tells which parts of the domain have changed."""
    table = Table(box=None, padding=(0, 2, 0, 0))
    for title in ("no.", "MACROP", "steps", "cost", "uses", "saved s"):
        table.add_column(title, justify="left" if title == "MACROP" else "right", overflow="fold")
    if stale:
        table.add_column("stale", overflow="fold")
    rows = list(stored)
    for each in rows:
        cost = "" if each.macrop.cost is None else str(each.macrop.cost)
        cells = [str(each.id), str(each.macrop.name), str(len(each.macrop.steps)), cost, str(each.uses)]
        cells.append(f"{each.saved_s:.2f}")
        table.add_row(*map(Text, cells), *([Text(", ".join(stale.get(each.id, ())))] if stale else []))
    return table if rows else Text("The library is empty.")


def folded(parts: Iterable[Mapping[str, Any]]) -> RenderableType | None:
    """A plan folded: one row for each MACROP in it, with its steps; None without any."""
    rows = list(parts)
    if not rows:
        return None
    table = Table(box=None, padding=(0, 2, 0, 0))
    for title in ("MACROP", "for", "steps"):
        table.add_column(title, overflow="fold")
    for part in rows:
        number = f"{part['macrop']} " if part["macrop"] is not None else ""
        table.add_row(Text(f"{number}{part['name']}"), Text(part["purpose"]), Text(_ranges(part["steps"])))
    return table


def _ranges(numbers: Iterable[int]) -> str:
    """`1..4, 7`."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][-1] + 1:
            runs[-1][1:] = [number]
        else:
            runs.append([number])
    return ", ".join("..".join(map(str, run)) for run in runs)


def figures(found: "Figures") -> RenderableType:
    """A library in numbers."""
    table = Table(box=None, show_header=False, padding=(0, 2, 0, 0))
    rows = [("MACROPs", str(found.macrops)), ("goal shapes", str(found.shapes)), ("uses", str(found.uses))]
    rows.append(("planning saved", f"{found.saved_s:.2f} s"))
    rows += [(f"of {name}", str(count)) for name, count in found.domains.items()]
    for title, said in [*rows, ("schema", str(found.schema))]:
        table.add_row(title, said)
    return table


def origin(kind: str, number: int | None, name: str, reason: str) -> Text:
    """One sentence on where a plan came from."""
    match kind:
        case "library":
            return Text(f"An instance of MACROP {number}, {name}.")
        case "parts":
            whole = f" The whole was learned as MACROP {number}, {name}." if number is not None else ""
            return Text(f"Composed of the parts above.{whole}")
        case "planner" if number is not None:
            return Text(f"Planned, and learned as MACROP {number}, {name}.")
        case "planner" if reason:
            return Text(f"Planned; not learned: {reason}.")
        case _:
            return Text()
