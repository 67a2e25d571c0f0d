"""Explanations why there is no plan or why a step is in it, as text and as data."""

from collections.abc import Iterator
from typing import Any

from rich.text import Text

from cellwright.engine.model.noun_wording import count_noun
from cellwright.engine.model.plan_explanation import Amendment, Explanation, Purpose, StepReason
from cellwright.engine.model.workflow_replay import said_of

IN_FULL = 6  # changes that are told with the way from the goal to what they give
_EDIT_WORDS = {  # what edits of one kind are said to be, and how each is said
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


def explanation_text(no_plan_explanation: Explanation) -> Text:
    """Why there is no plan, for people."""
    told = no_plan_explanation.goals or no_plan_explanation.gaps or no_plan_explanation.changes
    if no_plan_explanation.status != "infeasible" or not told:
        lines = [_reason_line(no_plan_explanation), *_relaxed_lines(no_plan_explanation)]
        return Text("\n".join(lines))
    lines = ["No plan exists."]
    if len(no_plan_explanation.goals) == 1:
        lines.append(f"This goal cannot be reached: {no_plan_explanation.goals[0]}")
    else:
        lines += [
            "These goals cannot be reached together, though any fewer of them can:"
            if no_plan_explanation.fewer
            else "No plan reaches all of these goals; whether fewer of them can be reached was "
            "not decided:"
        ]
        lines += [f"  {goal}" for goal in no_plan_explanation.goals]
    lines += [f"  because {exclusion}" for exclusion in no_plan_explanation.exclusions]
    lines += [f"  because {obstacle}" for obstacle in no_plan_explanation.obstacles]
    lines += [f"  {gap}" for gap in no_plan_explanation.gaps]
    if no_plan_explanation.gaps:
        lines.append(
            "An operator is missing, or its constraints never hold: no change of one fact would "
            "help."
        )
    elif not any(change.edits or change.stages for change in no_plan_explanation.changes):
        lines.append("No change of one fact would help, and none of two or three facts was found.")
    for number, change in enumerate(no_plan_explanation.changes):
        steps = f"{change.proof} step{'' if change.proof == 1 else 's'}"
        lines.append(f"There would be a plan of {steps} {amendment_text(change)}")
        lines += [f"    {line}" for line in change.missing] if number < IN_FULL else []
    if any(change.missing for change in no_plan_explanation.changes[IN_FULL:]):
        lines.append("`--format json` tells of every change how it leads to the goal.")
    if no_plan_explanation.untried:
        lines.append(
            f"{no_plan_explanation.untried} more changes of one fact were not tried to the end: "
            "a limit was reached."
        )
    return Text("\n".join(lines))


def _reason_line(no_plan_explanation: Explanation) -> str:
    head = {"feasible": "There is nothing to explain", "infeasible": "No plan exists"}
    return f"{head.get(no_plan_explanation.status, 'Unknown')}: {no_plan_explanation.reason}."


def _relaxed_lines(no_plan_explanation: Explanation) -> Iterator[str]:
    """The windows that would have to allow more time, or less."""
    steps = count_noun(no_plan_explanation.relaxed_steps, "step")
    if no_plan_explanation.relaxed:
        yield f"There would be a plan of {steps} that keeps all other windows and has"
    yield from (f"  {window}" for window in no_plan_explanation.relaxed)


def amendment_text(change: Amendment) -> str:
    """A change in words."""
    if change.goal:
        return f"without the goal {change.goal}"
    if change.stages:
        return f"if {' and '.join(map(str, change.stages))} were asked for as well"
    kinds: dict[str, list[str]] = {}
    for edit in change.edits:
        edit_words = _EDIT_WORDS[f"{edit.verb} {edit.layer}"][1]
        kinds.setdefault(f"{edit.verb} {edit.layer}", []).append(
            edit_words.format(edit.added, edit.removed)
        )
    return " and ".join(
        _EDIT_WORDS[kind][0].format(" and ".join(facts)) for kind, facts in kinds.items()
    )


def explanation_entry(no_plan_explanation: Explanation) -> dict[str, Any]:
    """Why there is no plan, for programs."""
    return {
        "goals": list(no_plan_explanation.goals),
        "exclusions": list(no_plan_explanation.exclusions),
        "obstacles": list(no_plan_explanation.obstacles),
        "reason": no_plan_explanation.reason,
        "untried": no_plan_explanation.untried,
        "gaps": list(no_plan_explanation.gaps),
        "relaxed": list(no_plan_explanation.relaxed),
        "changes": [
            {
                "kind": change.kind,
                "facts": list(map(str, change.facts)),
                "instead_of": [str(edit.removed) for edit in change.edits if edit.verb == "change"],
                "goal": change.goal,
                "steps": change.proof,
                "missing": list(change.missing),
            }
            for change in no_plan_explanation.changes
        ],
    }


def step_reason(reason_of_step: StepReason) -> Text:
    """Why a step is in the plan, for people."""
    step = reason_of_step.step
    lines = [f"{step.id} {step.operator}", "is there for"]
    lines += [f"  {_purpose_text(purpose)}" for purpose in reason_of_step.purposes] or [
        "  nothing: no causal link names it"
    ]
    after = [order for order in reason_of_step.orders if order.later.id == step.id]
    before = [order for order in reason_of_step.orders if order.earlier.id == step.id]
    lines += [f"comes after {o.earlier.id} {o.earlier.operator}: {o.reason}" for o in after]
    lines += [f"comes before {o.later.id} {o.later.operator}: {o.reason}" for o in before]
    return Text("\n".join(lines))


def _purpose_text(purpose: Purpose) -> str:
    if purpose.consumer is None:
        return f"the goal {said_of(purpose.condition)}"
    condition_text = (
        f"{said_of(purpose.condition)}, which {purpose.consumer.id} {purpose.consumer.operator} "
        "needs"
    )
    if purpose.links:
        consumer_chain = " then ".join(str(link.consumer) for link in purpose.links[:-1])
        condition_text += (
            f"{f' for {consumer_chain}' if consumer_chain else ''} for the goal "
            f"{said_of(purpose.links[-1].condition)}"
        )
    return condition_text


def step_entry(reason_of_step: StepReason) -> dict[str, Any]:
    """Why a step is in the plan, for programs."""
    return {
        "step": reason_of_step.step.id,
        "operator": str(reason_of_step.step.operator),
        "purposes": [
            {
                "condition": str(purpose.condition),
                "consumer": -1 if purpose.consumer is None else purpose.consumer.id,
                "path": [link.consumer for link in purpose.links],
            }
            for purpose in reason_of_step.purposes
        ],
        "orders": [
            {"before": o.earlier.id, "after": o.later.id, "reason": o.reason}
            for o in reason_of_step.orders
        ],
    }
