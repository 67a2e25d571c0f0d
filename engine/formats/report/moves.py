"""The motions of a plan, step by step, as text and as data."""

from typing import TYPE_CHECKING, Any

from cellwright.engine.model.moves import Leg, MovedStep, Unmoved

if TYPE_CHECKING:
    from rich.console import RenderableType

    from cellwright.engine.model.passing import Sharing, Zone
    from cellwright.engine.pipelines.moves.planning import Moving


def text(moving: "Moving") -> "list[RenderableType]":
    """A table of the motions, what had none, and the goals that are given up."""
    from rich.table import Table
    from rich.text import Text

    found: list[RenderableType] = []
    if moving.steps:
        table = Table("step", "at", "motion, with its time (s)", "in all (s)", box=None, pad_edge=False)
        for each in moving.steps:
            table.add_row(str(each.step), each.place, _legs(each), f"{each.seconds:.1f}")
        found += [table, Text(_proof(moving.steps))]
    if moving.sharing is not None:
        found += [Text(line) for line in sharing(moving.sharing)]
    for refused in moving.refused:
        found.append(Text(f"{refused.operator} was left out: it has no motion, {_where(refused)}"))
    found += [Text(f"{each.goal} is given up: {each.why}") for each in moving.given_up]
    return found


def sharing(shared: "Sharing") -> list[str]:
    """How the arms keep apart, as lines of text."""
    found = []
    for zone in shared.zones:
        who = "; ".join(f"{arm} in {_numbers(steps)}" for arm, steps in zone.steps.items())
        found.append(f"{zone.name}: a space of {_size(zone)} that the arms share: {who}")
    said = f"{shared.apart} pairs of steps of two arms are proved never to meet"
    if shared.ordered:
        said += f"; of {shared.ordered} that could, one waits for the other"
    return [*found, f"{said}. That holds however late a step is."]


def _numbers(steps: "tuple[int, ...]") -> str:
    return f"step {steps[0]}" if len(steps) == 1 else f"steps {', '.join(map(str, steps))}"


def _size(zone: "Zone") -> str:
    sides = (high - low for low, high in zip(zone.lower, zone.upper, strict=True))
    return " x ".join(f"{side:.2f}" for side in sides) + " m"


def _legs(step: MovedStep) -> str:
    parts = [f"{leg.kind.value} {leg.seconds:.1f}" for leg in step.legs if leg.seconds]
    return (
        ", ".join([*parts, *([f"there {step.takes_s:.1f}"] if step.takes_s else [])])
        or "none: it is there already"
    )


def _proof(steps: tuple[MovedStep, ...]) -> str:
    open_ = [each for each in steps if not each.proved]
    legs = sum(len(each.legs) for each in steps)
    if not open_:
        return f"{legs} paths, all proved to touch nothing that they may not"
    return f"{legs} paths; those of {len(open_)} steps are free wherever they were looked at, but not proved"


def _where(refused: Unmoved) -> str:
    while_ = f", while {', '.join(map(str, refused.while_true))}" if refused.while_true else ""
    return f"{refused.reason}{while_}"


def entry(moving: "Moving") -> dict[str, Any]:
    """The motions for JSON: joint values in rad or m, times in s from the start of each leg."""
    return {
        "motion": [_step(each) for each in moving.steps],
        "without_motion": [
            {
                "operator": str(each.operator),
                "place": each.place,
                "level": each.level,
                "reason": each.reason,
                "in_the_way": list(each.culprits),
                "while": list(map(str, each.while_true)),
            }
            for each in moving.refused
        ],
        "given_up": [{"goal": each.goal, "why": each.why} for each in moving.given_up],
        **({"sharing": _sharing(moving.sharing)} if moving.sharing is not None else {}),
    }


def _sharing(shared: "Sharing") -> dict[str, Any]:
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


def _step(step: MovedStep) -> dict[str, Any]:
    return {
        "step": step.step,
        "operator": str(step.operator),
        "place": step.place,
        "seconds": round(step.seconds, 6),
        "there_s": step.takes_s,
        "legs": [_leg(each) for each in step.legs],
    }


def _leg(leg: Leg) -> dict[str, Any]:
    return {
        "kind": leg.kind.value,
        "arm": leg.arm,
        "configurations": leg.path.tolist(),
        "times_s": leg.corners_s.tolist(),
        "proved": leg.proved,
        "holding": list(leg.holding),
        **({"beside": [_leg(each) for each in leg.beside]} if leg.beside else {}),
    }
