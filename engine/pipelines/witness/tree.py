"""What stands on what in the witness's model: which bodies are free, which carry an arm, and what holds a tool."""

from collections.abc import Iterator

from cellwright.engine.stages.geometry.world.model import World
from cellwright.kb.model.cell import BodyKind, Cell


def exchanged(cell: Cell) -> frozenset[str]:
    """The tools that arms take up and put down: those that places or measurements name."""
    named = {place.tool for place in cell.places.values()} | set(cell.measuring)
    return frozenset(name for name in named if name in cell.bodies)


def is_free(cell: Cell, body: str) -> bool:
    """Whether a body stands on nothing for good: a part, or a tool that is exchanged."""
    return cell.bodies[body].kind is BodyKind.PART or body in exchanged(cell)


def bearer_of(world: World, frame: str) -> str:
    """The body that a frame stands on, or `ARM.flange`, or `world`."""
    on = world.placed[frame].parent
    while on in world.cell.frames or ("." in on and on.partition(".")[0] in world.cell.bodies):
        on = world.placed[on].parent
    return on


def holder_of(world: World, tool: str) -> str:
    """The body of the model that holds a tool: what it hangs on, or the flange of the arm that has it."""
    on = bearer_of(world, tool)
    arm = on.partition(".")[0]
    return f"{arm}.flange" if arm in world.cell.arms else on


def carriers_of(world: World) -> frozenset[str]:
    """The bodies with a joint that carry an arm."""
    below = {each for arm in world.cell.arms for each in world.supports(f"{arm}.base")}
    bodies = world.cell.bodies
    return frozenset(each for each in below if each in bodies and bodies[each].guide is not None)


def held_by(world: World, arm: str) -> list[str]:
    """The parts and tools that an arm has in its hand."""
    return [
        name
        for name in world.cell.bodies
        if is_free(world.cell, name) and world.placed[name].parent in (f"{arm}.tool", f"{arm}.flange")
    ]


def worn_by(world: World, arm: str) -> Iterator[str]:
    """The bodies that are mounted on an arm for good: its gripper and the fingers."""
    for body in world.cell.bodies:
        on = world.supports(body)[1:]
        if not is_free(world.cell, body) and any(
            each.startswith(f"{arm}.") and each != f"{arm}.base" for each in on
        ):
            yield body


def hand_of(world: World, arm: str) -> list[str]:
    """The bodies with drives of their own on an arm: its fingers."""
    bodies = world.cell.bodies
    return [
        each
        for each in worn_by(world, arm)
        if (guide := bodies[each].guide) is not None and not guide.follows
    ]


def in_hand(world: World, body: str) -> bool:
    """Whether an arm has a part or tool in its hand."""
    return any(body in held_by(world, arm) for arm in world.cell.arms)


def in_hands(world: World) -> frozenset[str]:
    """The parts and tools that any arm has in its hand."""
    return frozenset(body for arm in world.cell.arms for body in held_by(world, arm))
