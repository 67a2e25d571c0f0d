"""Assemblies, portions of motions, and forecasts about an operator, as text and as data."""

from collections.abc import Iterator, Sequence
from typing import Any

from cellwright.engine.formats.report.cells import placing_report
from cellwright.engine.pipelines.manipulation.arm_monitoring import (
    GoalForecast,
    GoalOutlook,
    WatchedWorld,
)
from cellwright.engine.pipelines.manipulation.assembly_moves import (
    MoveKind,
    MoveObstacle,
    PartMove,
    PartSpot,
)
from cellwright.engine.pipelines.manipulation.assembly_order import AssemblyMade, Built
from cellwright.engine.pipelines.manipulation.place_answers import Carry, NotPlaced
from cellwright.engine.pipelines.manipulation.place_operation import BroughtPart, Portion
from cellwright.kb.model.part_scene import SaidRelation

SPOT_WORDS = {
    PartSpot.FOUND: "where it was found",
    PartSpot.ASIDE: "on the free place",
    PartSpot.GOAL: "at its goal",
}


def assembly_status(assembly: AssemblyMade) -> str:
    """The status word: only a contradiction of relations is proved impossible."""
    return "found" if isinstance(assembly, Built) else placing_report.placing_status(assembly.why)


def assembly_text(assembly: AssemblyMade, base: str) -> str:
    """An answer for people."""
    learned = list(
        dict.fromkeys(f"  {obstacle_text(met_obstacle)}" for met_obstacle in assembly.obstacles)
    )
    why = ["geometry forbade:", *learned] if learned else []
    if not isinstance(assembly, Built):
        headline = f"the parts are not assembled on {base}: {assembly.why.reason}"
        return "\n".join([headline, *why, f"  try: {assembly.why.hint}"])
    lines = [f"{len(assembly.moves)} moves build the assembly on {base}"]
    for n, (move, carries) in enumerate(assembly.moves, 1):
        lines.append(f"{n}. {_move_text(move)}")
        lines += [f"   {_assembly_carry_text(carry)}" for carry in carries]
    legs = [leg for _, carries in assembly.moves for carry in carries for leg in carry.legs]
    lines.append(
        f"{sum(leg.proved for leg in legs)} of {len(legs)} legs are proved free everywhere"
    )
    return "\n".join([*lines, *why])


def _move_text(move: PartMove) -> str:
    if move.end is PartSpot.ASIDE:
        return f"set {move.part} aside"
    again = ", with regrasps" if move.way is MoveKind.REGRASPED else ""
    start = (
        ""
        if move.start is PartSpot.FOUND
        else f" from {SPOT_WORDS[move.start].removeprefix('on ')}"
    )
    return f"place {move.part}{start}{again}"


def _assembly_carry_text(carry: Carry) -> str:
    to = "" if carry.rest == "goal" else f", laid down {carry.rest}"
    return f"taken at {placing_report.at_facets(carry.grasp)}{to}"


def obstacle_text(met_obstacle: MoveObstacle) -> str:
    """An obstacle as a sentence."""
    move = met_obstacle.move
    wanted_act = "be set aside" if move.end is PartSpot.ASIDE else "be placed"
    how = " with regrasps" if move.way is MoveKind.REGRASPED else ""
    return (
        f"{move.part} cannot {wanted_act}{how}{_obstacle_during(met_obstacle)}: "
        f"{met_obstacle.reason}"
    )


def _obstacle_during(met_obstacle: MoveObstacle) -> str:
    during = [f"{part} is {SPOT_WORDS[spot]}" for part, spot in met_obstacle.during]
    until = (
        f" until {_join_names(met_obstacle.until, 'or')} is at its goal"
        if met_obstacle.until
        else ""
    )
    return (f" while {_join_names(during, 'and')}" if during else "") + until


def _join_names(names: Sequence[str], word: str) -> str:
    """Names as in a sentence: `a`, `a and b`, `a, b and c`."""
    return f" {word} ".join([*([", ".join(names[:-1])] if names[:-1] else []), *names[-1:]])


def assembly_content(assembly: AssemblyMade) -> dict[str, Any]:
    """An answer for JSON: poses as rows of matrices, metres and radians."""
    obstacles = [_obstacle_entry(met_obstacle) for met_obstacle in assembly.obstacles]
    if not isinstance(assembly, Built):
        why = {"step": assembly.why.step, "reason": assembly.why.reason, "hint": assembly.why.hint}
        return {**why, "obstacles": obstacles}
    return {"moves": list(_move_entries(assembly)), "obstacles": obstacles}


def _move_entries(assembly: Built) -> Iterator[dict[str, Any]]:
    for step, (move, carries) in zip(assembly.plan.steps, assembly.moves, strict=True):
        yield {
            "step": str(step.operator),
            "part": move.part,
            "from": move.start,
            "to": move.end,
            "carries": [placing_report.carry_entry(carry) for carry in carries],
        }


def _obstacle_entry(met_obstacle: MoveObstacle) -> dict[str, Any]:
    return {
        "part": met_obstacle.move.part,
        "way": met_obstacle.move.way,
        "from": met_obstacle.move.start,
        "to": met_obstacle.move.end,
        "reason": met_obstacle.reason,
        "during": [list(during_move) for during_move in met_obstacle.during],
        "until": list(met_obstacle.until),
    }


OUTLOOK_WORDS = {
    GoalOutlook.DONE: "the part is at its goal",
    GoalOutlook.OPEN: "the goal can be reached",
    GoalOutlook.HARD: "the goal is hard to reach",
    GoalOutlook.IMPOSSIBLE: "the goal cannot be reached",
}


def portion_status(portion: Portion) -> str:
    """The status word of a portion."""
    return placing_report.placing_status(portion) if isinstance(portion, NotPlaced) else "found"


def portion_content(portion: Portion) -> dict[str, Any]:
    """A portion for JSON: poses as rows of matrices, metres and radians."""
    if isinstance(portion, NotPlaced):
        return {"step": portion.step, "reason": portion.reason, "hint": portion.hint}
    return {
        "T_world_part": portion.T_world_part.tolist(),
        "facets": list(portion.grasp.facets),
        "legs": [placing_report.leg_entry(leg) for leg in portion.legs],
    }


def portion_text(portion: Portion, relation: SaidRelation) -> str:
    """A portion for people."""
    if not isinstance(portion, BroughtPart):
        return f"'{relation}' is not reached: {portion.reason}\n  try: {portion.hint}"
    part = relation.first[0]
    lines = [
        f"{part} lies at {placing_report.pose_text(portion.T_world_from)}",
        f"'{relation}' holds at {placing_report.pose_text(portion.T_world_part)}, "
        f"{placing_report.freedom_text(portion.goal)}",
        f"taken at {placing_report.at_facets(portion.grasp)}, and held there",
        *(placing_report.leg_text(leg) for leg in portion.legs),
    ]
    return "\n".join(lines)


def followed_text(
    state: WatchedWorld, forecasts: Sequence[tuple[WatchedWorld, GoalForecast | None]]
) -> str:
    """What is said after each event, for people."""
    before = state.forecast
    lines = [f"at first: {_outlook_text(before)}"]
    for n, (after, warning) in enumerate(forecasts, 1):
        mark = "WARNING: " if warning is not None else ""
        in_hand_text = " (in the hand)" if after.T_part_hand is not None else ""
        same = after.forecast == before
        lines.append(
            f"act {n}{in_hand_text}: {mark}{'as before' if same else _outlook_text(after.forecast)}"
        )
        before = after.forecast
    return "\n".join(lines)


def _outlook_text(forecast: GoalForecast) -> str:
    return OUTLOOK_WORDS[forecast.outlook] + (f": {forecast.reason}" if forecast.reason else "")


def followed_content(
    state: WatchedWorld, forecasts: Sequence[tuple[WatchedWorld, GoalForecast | None]]
) -> dict[str, Any]:
    """The same for JSON."""
    return {
        "at_first": _forecast_entry(state, state.forecast, False),
        "acts": [
            _forecast_entry(after, after.forecast, warning is not None)
            for after, warning in forecasts
        ],
    }


def _forecast_entry(state: WatchedWorld, forecast: GoalForecast, warned: bool) -> dict[str, Any]:
    return {
        "outlook": forecast.outlook.name.lower(),
        "reason": forecast.reason,
        "warned": warned,
        "held": state.T_part_hand is not None,
        "T_world_part": state.T_world_part.tolist(),
    }
