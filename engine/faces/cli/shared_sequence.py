"""`cellwright sequence` for a cell whose arms share the measurements of a problem."""

from typing import TYPE_CHECKING

from cellwright.engine.faces.cli.answers import Answer
from cellwright.engine.faces.cli.exits import GAVE_UP, INFEASIBLE, INTERRUPTED

if TYPE_CHECKING:
    from cellwright.kb.model.problem import Problem


def shared_by_arms(
    problem: "Problem",
    wanted: tuple[list[str], list[str], list[str]],
    effort: tuple[float | None, int, int],
) -> Answer:
    """Which arm makes which measurements, in which order. Raises `InvalidInput`."""
    from rich.console import Group
    from rich.text import Text

    from cellwright.engine.faces.cli.interruption import Interruption
    from cellwright.engine.formats.report import inspection, json, shares
    from cellwright.engine.pipelines.inspection.demands import known, of_options
    from cellwright.engine.pipelines.parts import Shared, shares_of
    from cellwright.engine.pipelines.points import with_places
    from cellwright.engine.stages.sequencing import Limits

    demands, placed = of_options(*wanted), with_places(problem)
    with Interruption(effort[0]) as interrupted:
        found = shares_of(placed, demands, Limits(effort[1], effort[2], interrupted))
    assert found is not None
    if not isinstance(found, Shared):
        reason, code = found.reason, INFEASIBLE if json.status(found) == "infeasible" else GAVE_UP
        return Answer(json.status(found), {"reason": reason}, lambda: Text(f"No shares: {reason}."), code)
    known(demands, set(found.arms))
    content = {**shares.entry(found), "partition": inspection.entry(found.partition)}
    late = [Text(f"Not all windows can be kept: {found.unkept}.")] if found.unkept else []
    return Answer(
        "optimal" if found.shares.makespan <= found.shares.lower_bound else "found",
        content,
        lambda: Group(inspection.parts(found.partition), shares.text(found), *late),
        INTERRUPTED if interrupted.heard else 0,
    )
