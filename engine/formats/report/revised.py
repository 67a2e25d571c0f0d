"""A revised plan, and what of the old one was kept."""

from typing import TYPE_CHECKING, Any

from cellwright.engine.model.wording import counted

if TYPE_CHECKING:
    from rich.console import RenderableType

    from cellwright.engine.pipelines.revision import PlanRevision
    from cellwright.kb.terms import Atom

    Follows = tuple[tuple[Atom, bool], ...]


def entry(found: "PlanRevision", follows: "Follows") -> dict[str, Any]:
    """The revision as data: the steps kept, dropped and added, and what follows from what was observed."""
    from cellwright.engine.formats.report.recovery import given_up_entry

    parts = {"kept": found.kept, "dropped": found.dropped, "added": found.added}
    return {
        "way": found.way,
        **{name: [str(step.operator) for step in steps] for name, steps in parts.items()},
        "repair_cost": found.repair_cost,
        "replanning_cost": found.replanning_cost,
        "follows": {str(atom): holds for atom, holds in follows},
        "given_up": given_up_entry(found.given_up),
    }


def text(found: "PlanRevision", follows: "Follows") -> "RenderableType":
    """The revision as people read it."""
    from rich.console import Group
    from rich.text import Text

    from cellwright.engine.formats.report import text
    from cellwright.engine.formats.report.recovery import given_up_lines

    said = [
        f"{found.way}: {counted(len(found.kept), 'step')} kept, {len(found.dropped)} dropped, {len(found.added)} added"
    ]
    said += [f"  - {step.operator}" for step in found.dropped]
    said += [f"  + {step.operator}" for step in found.added]
    if found.repair_cost is not None and found.replanning_cost is not None:
        said.append(f"repair costs {found.repair_cost}, replanning {found.replanning_cost}")
    said += [f"follows: {atom}" if holds else f"follows: not {atom}" for atom, holds in follows]
    said += given_up_lines((each.goal, each.why) for each in found.given_up)
    return Group(text.outcome(found.outcome, found.problem), Text("\n".join(said)))
