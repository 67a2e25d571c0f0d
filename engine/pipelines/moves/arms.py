"""Which arms take part in a step, and the cell as these arms meet it while they take it.

A step is planned with the arms that it names alone. They stand where they are. All other arms are left out: when they come near,
the schedule keeps them apart (`cellwright.engine.pipelines.moves.passing`).
"""

from cellwright.engine.stages.geometry.world.model import World
from cellwright.kb.model.cell import Cell, Operation
from cellwright.kb.terms import Function


def arms_of(cell: Cell, step: Function, operation: Operation | None) -> tuple[str, ...]:
    """The arms that a step names, that its places belong to, or that its body carries; in the order of the cell."""
    if len(cell.arms) == 1:
        return tuple(cell.arms)
    named = {str(each) for each in step.arguments}
    if operation is not None:
        ends = (str(each) for each in (operation.at, operation.with_place) if each is not None)
        named |= {cell.places[each].arm for each in ends if each in cell.places}
        named |= set(_riders(cell, operation.drives)) if operation.drives else set()
    return tuple(arm for arm in cell.arms if arm in named)


def _riders(cell: Cell, body: str) -> list[str]:
    """The arms that a body carries."""
    world = World.of(cell)
    return [arm for arm in cell.arms if body in world.supports(f"{arm}.base")]
