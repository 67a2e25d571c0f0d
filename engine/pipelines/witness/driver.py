"""The driver `mujoco`: steps of the arm are played by the physics engine, which decides whether they have worked.

Everything else, tests and repairs too, is as in the simulator: a fault is there by its cause, and tests are answered by it.
The clock is virtual; a step lasts as long as its motion was planned to, or as the plan says where it has none.
"""

from collections.abc import Mapping

from cellwright.engine.pipelines.gate import PlanGate
from cellwright.engine.pipelines.moves.walking import Walk
from cellwright.engine.pipelines.simulator import HiddenCell, Simulator, fault_base, number_of, settings_of
from cellwright.engine.pipelines.simulator.unknown import OPTIONS, moving_cell, unknown_of
from cellwright.engine.pipelines.witness.body import Body, Hindrance
from cellwright.engine.pipelines.witness.tree import is_free
from cellwright.engine.plugins import geometry_backend
from cellwright.engine.ports import DriverSetup
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, nearest
from cellwright.kb.model.cell import Cell

OWN = ("friction", "block", "stick")


def physical(setup: DriverSetup) -> Simulator:
    """The physical cell for a run. Options beside those of the simulator: friction, block and stick. Raises `InvalidInput`."""
    settings, unknown = settings_of(setup, (*OWN, *OPTIONS)), unknown_of(setup.options, setup.problem)
    cell = moving_cell(setup.problem.domain.path)
    hindrance = _hindrance(setup.options, cell)
    semantics = PlanGate().semantics(setup.problem)
    walk = Walk(semantics, cell, geometry_backend(), setup.seed)
    body = Body(walk, semantics.initial(), hindrance, unknown)
    base = fault_base(setup.problem)
    hidden = HiddenCell(setup.problem, base, settings.injections, setup.seed, body=body, unknown=unknown)
    return Simulator(hidden, settings)


def _hindrance(options: Mapping[str, str], cell: Cell) -> Hindrance:
    friction = number_of(options, "friction", -1.0) if "friction" in options else None
    if friction is not None and not 0.0 < friction <= 10.0:
        said = f"a friction of {options['friction']} is no share of a force"
        raise InvalidInput([Diagnostic(Source("--option"), "K107", said, "write friction=0.1")])
    joints = [name for name, body in cell.bodies.items() if body.guide is not None]
    parts = [name for name in cell.bodies if is_free(cell, name)]
    return Hindrance(
        friction,
        tuple(_known("block", options, joints, "joint")),
        tuple(_known("stick", options, parts, "part or tool")),
    )


def _known(option: str, options: Mapping[str, str], names: list[str], kind: str) -> list[str]:
    """The bodies that an option names, with commas between them."""
    asked = [each.strip() for each in options.get(option, "").split(",") if each.strip()]
    for each in asked:
        if each not in names:
            hint = nearest(each, names) or f"one of: {', '.join(names)}"
            said = f"the cell has no {kind} '{each}'"
            raise InvalidInput([Diagnostic(Source(f"--option {option}"), "K107", said, hint)])
    return asked
