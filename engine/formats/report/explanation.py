"""Explanations as text and as data."""

from typing import Any

from rich.text import Text

from cellwright.engine.model.explanation import Amendment, Explanation, Purpose, StepReason
from cellwright.engine.model.stages import said_of

IN_FULL = 6  # changes that are told with the way from the goal to what they give
_SAID = {  # what edits of one kind are said to be, and how each is said
    "add static": ("if the problem also said {}", "{0}"),
    "remove static": ("if nothing said {}", "{1}"),
    "change static": ("if the problem said {}", "{0} instead of {1}"),
    "add initial": ("if {} held at the start", "{0}"),
    "remove initial": ("if {} did not hold at the start", "{1}"),
    "change initial": ("if {}", "{0} held at the start instead of {1}"),
    "add object": ("with one more object: {}", "{0}"),
    "remove object": ("without the object {}", "{1}"),
    "change object": ("with the object {}", "{0} instead of {1}"),
}


def explanation(found: Explanation) -> Text:
    """Why there is no plan, for people."""
    if found.status != "infeasible":
        return Text(
            f"{'There is nothing to explain' if found.status == 'feasible' else 'Unknown'}: {found.reason}."
        )
    lines = ["No plan exists."]
    if len(found.goals) == 1:
        lines.append(f"This goal cannot be reached: {found.goals[0]}")
    else:
        lines += ["These goals cannot be reached together, though any fewer of them can:"]
        lines += [f"  {goal}" for goal in found.goals]
    lines += [f"  because {exclusion}" for exclusion in found.exclusions]
    lines += [f"  {gap}" for gap in found.gaps]
    if found.gaps:
        lines.append(
            "An operator is missing, or its constraints never hold: no change of one fact would help."
        )
    elif not any(change.edits or change.stages for change in found.changes):
        lines.append("No change of one fact would help, and none of two or three facts was found.")
    for number, change in enumerate(found.changes):
        steps = f"{change.proof} step{'' if change.proof == 1 else 's'}"
        lines.append(f"There would be a plan of {steps} {said(change)}")
        lines += [f"    {line}" for line in change.missing] if number < IN_FULL else []
    if any(change.missing for change in found.changes[IN_FULL:]):
        lines.append("`--format json` tells of every change how it leads to the goal.")
    if found.untried:
        lines.append(
            f"{found.untried} more changes of one fact were not tried to the end: a limit was reached."
        )
    return Text("\n".join(lines))


def said(change: Amendment) -> str:
    """A change in words."""
    if change.goal:
        return f"without the goal {change.goal}"
    if change.stages:
        return f"if {' and '.join(map(str, change.stages))} were asked for as well"
    kinds: dict[str, list[str]] = {}
    for edit in change.edits:
        way = _SAID[f"{edit.verb} {edit.layer}"][1]
        kinds.setdefault(f"{edit.verb} {edit.layer}", []).append(way.format(edit.added, edit.removed))
    return " and ".join(_SAID[kind][0].format(" and ".join(facts)) for kind, facts in kinds.items())


def explanation_entry(found: Explanation) -> dict[str, Any]:
    """Why there is no plan, for programs."""
    return {
        "goals": list(found.goals),
        "exclusions": list(found.exclusions),
        "reason": found.reason,
        "untried": found.untried,
        "gaps": list(found.gaps),
        "changes": [
            {
                "kind": change.kind,
                "facts": list(map(str, change.facts)),
                "instead_of": [str(edit.removed) for edit in change.edits if edit.verb == "change"],
                "goal": change.goal,
                "steps": change.proof,
                "missing": list(change.missing),
            }
            for change in found.changes
        ],
    }


def step_reason(found: StepReason) -> Text:
    """Why a step is in the plan, for people."""
    step = found.step
    lines = [f"{step.id} {step.operator}", "is there for"]
    lines += [f"  {_purpose(purpose)}" for purpose in found.purposes] or [
        "  nothing: no causal link names it"
    ]
    after = [order for order in found.orders if order.later.id == step.id]
    before = [order for order in found.orders if order.earlier.id == step.id]
    lines += [f"comes after {o.earlier.id} {o.earlier.operator}: {o.reason}" for o in after]
    lines += [f"comes before {o.later.id} {o.later.operator}: {o.reason}" for o in before]
    return Text("\n".join(lines))


def _purpose(purpose: Purpose) -> str:
    if purpose.consumer is None:
        return f"the goal {said_of(purpose.condition)}"
    said = f"{said_of(purpose.condition)}, which {purpose.consumer.id} {purpose.consumer.operator} needs"
    if purpose.links:
        way = " then ".join(str(link.consumer) for link in purpose.links[:-1])
        said += f"{f' for {way}' if way else ''} for the goal {said_of(purpose.links[-1].condition)}"
    return said


def step_entry(found: StepReason) -> dict[str, Any]:
    """Why a step is in the plan, for programs."""
    return {
        "step": found.step.id,
        "operator": str(found.step.operator),
        "purposes": [
            {
                "condition": str(purpose.condition),
                "consumer": -1 if purpose.consumer is None else purpose.consumer.id,
                "path": [link.consumer for link in purpose.links],
            }
            for purpose in found.purposes
        ],
        "orders": [{"before": o.earlier.id, "after": o.later.id, "reason": o.reason} for o in found.orders],
    }
