"""Motions of a plan, step by step, as text and as data."""

from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from cellwright.engine.formats.report import rich_parts
from cellwright.engine.model.motion_values import MovedStep, StepLeg, Unmoved, UnprovedStep

if TYPE_CHECKING:
    from rich.console import RenderableType

    from cellwright.engine.model.motion_values import SharedZone, Sharing
    from cellwright.engine.pipelines.motion.moving_plan import MovingRun


MAX_STILL_STEPS = 6  # steps without a motion that are named one by one


def plan_motions_text(moving: "MovingRun") -> "list[RenderableType]":
    """A table of the motions, what had none, and the goals that are given up."""
    report_parts: list[RenderableType] = []
    if moving.steps:
        table = rich_parts.Table(
            "step", "at", "motion, with its time (s)", "in all (s)", box=None, pad_edge=False
        )
        for step in moving.steps:
            table.add_row(
                str(step.step), _place_words(step), _leg_words(step), f"{step.seconds:.1f}"
            )
        report_parts += [table, rich_parts.Text(_proof_text(moving.steps))]
    report_parts += [rich_parts.Text(line) for line in unproved_lines(moving.unproved)]
    if moving.sharing is not None:
        report_parts += [rich_parts.Text(line) for line in sharing_lines(moving.sharing)]
    for refused in moving.refused:
        report_parts.append(
            rich_parts.Text(
                f"{refused.operator} was left out: it has no motion, {_refusal_place(refused)}"
            )
        )
    report_parts += [
        rich_parts.Text(f"{given_up_goal.goal} is given up: {given_up_goal.why}")
        for given_up_goal in moving.given_up
    ]
    return report_parts


def sharing_lines(shared: "Sharing") -> list[str]:
    """How the arms keep apart, as lines of text."""
    apart_lines = []
    for zone in shared.zones:
        who = "; ".join(f"{arm} in {_step_numbers(steps)}" for arm, steps in zone.steps.items())
        apart_lines.append(f"{zone.name}: a space of {_zone_size(zone)} that the arms share: {who}")
    apart_text = f"{shared.apart} pairs of steps of two arms are proved never to meet"
    if shared.ordered:
        apart_text += f"; of {shared.ordered} that could, one waits for the other"
    return [*apart_lines, f"{apart_text}. That holds however late a step is."]


def _step_numbers(steps: "tuple[int, ...]") -> str:
    return f"step {steps[0]}" if len(steps) == 1 else f"steps {', '.join(map(str, steps))}"


def _zone_size(zone: "SharedZone") -> str:
    sides = (high - low for low, high in zip(zone.lower, zone.upper, strict=True))
    return " x ".join(f"{side:.2f}" for side in sides) + " m"


def _place_words(step: MovedStep) -> str:
    return ", ".join(stop.place for stop in step.stops) or step.place


def _leg_words(step: MovedStep) -> str:
    parts = [f"{leg.kind.value} {leg.seconds:.1f}" for leg in step.legs if leg.seconds]
    return (
        ", ".join([*parts, *([f"there {step.takes_s:.1f}"] if step.takes_s else [])])
        or "none: it is there already"
    )


def _proof_text(steps: tuple[MovedStep, ...]) -> str:
    open_ = [step for step in steps if not step.proved]
    legs = sum(len(step.legs) for step in steps)
    if not open_:
        moving = f"{legs} paths of {_steps_counted(len(steps))}"
        return f"{moving}, all proved to touch nothing that they may not"
    return (
        f"{legs} paths; those of {_steps_counted(len(open_))} are free wherever they were looked "
        "at, but not proved"
    )


def _steps_counted(count: int) -> str:
    return "1 step" if count == 1 else f"{count} steps"


def unproved_lines(unproved: "Sequence[UnprovedStep]") -> list[str]:
    """Which steps have no motion, and which bring a body somewhere without one."""
    still = [step for step in unproved if not step.place and not step.bodies]
    lines = [_still_line(still)] if still else []
    for step in unproved:
        if step.bodies:
            bodies, where = ", ".join(step.bodies), ""
            if step.place:
                where = f" beside {step.place}"
                hint = "; `at` in its operation may name several places in a row"
            else:
                hint = "; no operation says what an arm does in it"
            lines.append(
                f"not proved: step {step.step}, {step.operator}, moves {bodies} without a "
                f"motion{where}{hint}"
            )
    return lines


def _still_line(still: "Sequence[UnprovedStep]") -> str:
    """The steps without a motion that move nothing in the cell; many of them by their operators."""
    if len(still) <= MAX_STILL_STEPS:
        named = "; ".join(f"{step.step} {step.operator}" for step in still)
    else:
        counts = Counter(step.operator.name for step in still)
        named = ", ".join(f"{count} of {name}" for name, count in sorted(counts.items()))
    return f"without a motion: {_steps_counted(len(still))} ({named})"


def _refusal_place(refused: Unmoved) -> str:
    while_ = f", while {', '.join(map(str, refused.while_true))}" if refused.while_true else ""
    return f"{refused.reason}{while_}"


def plan_motions_entry(moving: "MovingRun") -> dict[str, Any]:
    """The motions for JSON: joint values in rad or m, times in s from the start of each leg."""
    return {
        "motion": [_step_entry(step) for step in moving.steps],
        "without_motion": [
            {
                "operator": str(refused_step.operator),
                "place": refused_step.place,
                "level": refused_step.level,
                "reason": refused_step.reason,
                "in_the_way": list(refused_step.culprits),
                "while": list(map(str, refused_step.while_true)),
            }
            for refused_step in moving.refused
        ],
        "unproved": [
            {
                "step": step.step,
                "operator": str(step.operator),
                "place": step.place,
                "bodies": list(step.bodies),
            }
            for step in moving.unproved
        ],
        "given_up": [
            {"goal": given_up_goal.goal, "why": given_up_goal.why}
            for given_up_goal in moving.given_up
        ],
        **({"sharing": _sharing_entry(moving.sharing)} if moving.sharing is not None else {}),
    }


def _sharing_entry(shared: "Sharing") -> dict[str, Any]:
    return {
        "zones": [
            {
                "name": zone.name,
                "lower_m": list(zone.lower),
                "upper_m": list(zone.upper),
                "steps": {arm: list(steps) for arm, steps in zone.steps.items()},
            }
            for zone in shared.zones
        ],
        "never_meet": shared.apart,
        "ordered": shared.ordered,
        "orders": sorted(map(list, shared.held)),
    }


def _step_entry(step: MovedStep) -> dict[str, Any]:
    return {
        "step": step.step,
        "operator": str(step.operator),
        "place": step.place,
        "seconds": round(step.seconds, 6),
        "there_s": step.takes_s,
        "legs": [_step_leg_entry(leg) for leg in step.legs],
    }


def _step_leg_entry(leg: StepLeg) -> dict[str, Any]:
    return {
        "kind": leg.kind.value,
        "arm": leg.arm,
        "configurations": leg.path.tolist(),
        "times_s": leg.corners_s.tolist(),
        "proved": leg.proved,
        "holding": list(leg.holding),
        **(
            {"beside": [_step_leg_entry(beside_leg) for beside_leg in leg.beside]}
            if leg.beside
            else {}
        ),
    }
