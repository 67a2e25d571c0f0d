"""What an assembly answers, as text and as content for JSON."""

from collections.abc import Iterator, Sequence
from typing import Any

from cellwright.engine.formats.report import placing
from cellwright.engine.pipelines.placing.answers import Carry
from cellwright.engine.pipelines.placing.assembling import AssemblyMade, Built
from cellwright.engine.pipelines.placing.yard import Move, Obstacle, Spot, Way

WHERE = {Spot.FOUND: "where it was found", Spot.ASIDE: "on the free place", Spot.GOAL: "at its goal"}


def status(made: AssemblyMade) -> str:
    """The status word: only a contradiction of relations is proved impossible."""
    return "found" if isinstance(made, Built) else placing.status(made.why)


def text(made: AssemblyMade, base: str) -> str:
    """An answer for people."""
    learned = list(dict.fromkeys(f"  {obstacle(each)}" for each in made.obstacles))
    why = ["geometry forbade:", *learned] if learned else []
    if not isinstance(made, Built):
        said = f"the parts are not assembled on {base}: {made.why.reason}"
        return "\n".join([said, *why, f"  try: {made.why.hint}"])
    lines = [f"{len(made.moves)} moves build the assembly on {base}"]
    for n, (move, carries) in enumerate(made.moves, 1):
        lines.append(f"{n}. {_move(move)}")
        lines += [f"   {_carry(each)}" for each in carries]
    legs = [leg for _, carries in made.moves for each in carries for leg in each.legs]
    lines.append(f"{sum(leg.proved for leg in legs)} of {len(legs)} legs are proved free everywhere")
    return "\n".join([*lines, *why])


def _move(move: Move) -> str:
    if move.end is Spot.ASIDE:
        return f"set {move.part} aside"
    again = ", with regrasps" if move.way is Way.REGRASPED else ""
    start = "" if move.start is Spot.FOUND else f" from {WHERE[move.start].removeprefix('on ')}"
    return f"place {move.part}{start}{again}"


def _carry(carry: Carry) -> str:
    to = "" if carry.rest == "goal" else f", laid down {carry.rest}"
    return f"taken at {placing.at_facets(carry.grasp)}{to}"


def obstacle(one: Obstacle) -> str:
    """An obstacle as a sentence."""
    move = one.move
    what = "be set aside" if move.end is Spot.ASIDE else "be placed"
    how = " with regrasps" if move.way is Way.REGRASPED else ""
    return f"{move.part} cannot {what}{how}{_while(one)}: {one.reason}"


def _while(one: Obstacle) -> str:
    during = [f"{part} is {WHERE[spot]}" for part, spot in one.during]
    until = f" until {_listed(one.until, 'or')} is at its goal" if one.until else ""
    return (f" while {_listed(during, 'and')}" if during else "") + until


def _listed(names: Sequence[str], word: str) -> str:
    """Names as in a sentence: `a`, `a and b`, `a, b and c`."""
    return f" {word} ".join([*([", ".join(names[:-1])] if names[:-1] else []), *names[-1:]])


def content(made: AssemblyMade) -> dict[str, Any]:
    """An answer for JSON: poses as rows of matrices, metres and radians."""
    obstacles = [_obstacle(each) for each in made.obstacles]
    if not isinstance(made, Built):
        why = {"step": made.why.step, "reason": made.why.reason, "hint": made.why.hint}
        return {**why, "obstacles": obstacles}
    return {"moves": list(_moves(made)), "obstacles": obstacles}


def _moves(made: Built) -> Iterator[dict[str, Any]]:
    for step, (move, carries) in zip(made.plan.steps, made.moves, strict=True):
        yield {
            "step": str(step.operator),
            "part": move.part,
            "from": move.start,
            "to": move.end,
            "carries": [placing.carry(each) for each in carries],
        }


def _obstacle(one: Obstacle) -> dict[str, Any]:
    return {
        "part": one.move.part,
        "way": one.move.way,
        "from": one.move.start,
        "to": one.move.end,
        "reason": one.reason,
        "during": [list(each) for each in one.during],
        "until": list(one.until),
    }
