"""Unmodelled bodies and facts of a simulated cell, which nobody knows until they are met.

    --option obstacles=FILE    # a `cell.yaml` with the bodies under `fixtures`
    --option really=FACTS      # "at(brick, top); -at(brick, shelf)": what is true, and
                               # behind a `-` what is not

What the arm has met is known from then on.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from cellwright.engine.model.run_protocol import BODIES_SEEN
from cellwright.engine.pipelines.motion.seen_bodies import look_at, placing_facts, with_seen
from cellwright.engine.pipelines.recovery import Dynamics
from cellwright.engine.pipelines.recovery.observations import correct_state, read_facts
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.loader.cell import load_cell
from cellwright.kb.model.cell_model import Body, Cell
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.targets import CELL_FILE
from cellwright.kb.terms import Atom

UNKNOWN_OPTIONS = ("obstacles", "really")
OBSTACLES_HINT = "write `cell: NAME`, and below `fixtures:` the bodies, as in a cell.yaml"


@dataclass
class UnmodelledThings:
    """The unknown in one cell.

    `true` are facts of the beginning that nobody knows, `false` those that are believed instead.
    """

    cell: Cell
    bodies: Mapping[str, Body] = field(default_factory=dict)
    true: frozenset[Atom] = frozenset()
    false: frozenset[Atom] = frozenset()
    met: set[str] = field(default_factory=set)

    @property
    def names(self) -> frozenset[str]:
        """The bodies that nobody knows of, or not where they are, as long as the arm has not
        met them.
        """
        return frozenset({*self.bodies, *self._misplaced}) - self.met

    def real(self, start: Collection[Atom]) -> frozenset[Atom]:
        """The facts with which the cell really begins."""
        return (frozenset(start) - self.false) | self.true

    @property
    def whole(self) -> Cell:
        """The cell as it is."""
        return replace(self.cell, bodies={**self.cell.bodies, **self.bodies})

    @property
    def known(self) -> Cell:
        """The cell as it is known: with those bodies that were met, as they were told of."""
        world = GeometricWorld.of(self.whole)
        return with_seen(
            self.cell,
            [look_at(world, name, boxed=True) for name in sorted(self.met & {*self.bodies})],
        )

    def believed(self, facts: Collection[Atom]) -> frozenset[Atom]:
        """What is believed where some facts are true."""
        now = frozenset(facts)
        hidden = self.true & now if self._misplaced - self.met else frozenset()
        return (now - hidden) | self.false if hidden else now

    def meets(self, name: str, world: GeometricWorld) -> dict[str, Any]:
        """The arm has met a body, where it is in a world: what a reply tells of that."""
        self.met.add(name)
        return {BODIES_SEEN: {name: look_at(world, name, boxed=name in self.bodies).entry()}}

    @property
    def _misplaced(self) -> frozenset[str]:
        moved = self.true | self.false
        return frozenset(
            name for name in self.cell.bodies if moved and placing_facts(self.cell, moved, (name,))
        )


def unknown_of(options: Mapping[str, str], problem: Problem) -> UnmodelledThings | None:
    """What the options of a driver hide; None if they hide nothing. Raises `InvalidInput`."""
    if not any(options.get(name) for name in UNKNOWN_OPTIONS):
        return None
    cell = moving_cell(problem.domain.path)
    bodies = _obstacle_bodies(options["obstacles"], cell) if options.get("obstacles") else {}
    start = Dynamics(problem).start().facts
    now = (
        frozenset(_true_facts(options["really"], problem, start))
        if options.get("really")
        else start
    )
    return UnmodelledThings(cell, bodies, now - start, start - now)


def _true_facts(text: str, problem: Problem, start: frozenset[Atom]) -> tuple[Atom, ...]:
    parts = [part.strip() for part in text.split(";") if part.strip()]
    holds = ", ".join(part for part in parts if not part.startswith("-"))
    gone = ", ".join(part[1:].strip() for part in parts if part.startswith("-"))
    read = [
        read_facts(facts_text, problem.domain, "--option really") for facts_text in (holds, gone)
    ]
    return correct_state(Dynamics(problem), start, *read)


def _obstacle_bodies(file: str, cell: Cell) -> Mapping[str, Body]:
    read = _read_obstacles(Path(file))
    bodies, other_names = read.bodies, {*read.arms, *read.places, *read.zones}
    if other_names:
        reason = f"it has more than bodies: {', '.join(sorted(other_names))}"
        raise _option_error(
            file, "K405", reason, "keep only what stands in the way, under `fixtures`"
        )
    if not bodies:
        raise _option_error(file, "K405", "there is no body in it", OBSTACLES_HINT)
    for name, body in bodies.items():
        if not body.shapes:
            raise _option_error(
                file, "K405", f"'{name}' has no shapes, so nothing can touch it", "give it `shapes`"
            )
        if name in cell.bodies or name in cell.arms or name in cell.frames:
            hint = "choose another name; say where a known body is with --option really=FACTS"
            raise _option_error(file, "K104", f"the cell has a '{name}' already", hint)
    return bodies


def _read_obstacles(file: Path) -> Cell:
    """The cell in a file of obstacles.

    Raises `InvalidInput`, for an empty file with what belongs into it.
    """
    if file.is_file() and not file.read_bytes().strip():
        raise _option_error(str(file), "K002", "the file is empty", OBSTACLES_HINT)
    return load_cell(file)


def moving_cell(domain: str) -> Cell:
    """The cell beside a domain file, in which an arm moves. Raises `InvalidInput`."""
    path = Path(domain).with_name(CELL_FILE)
    if not domain or not path.is_file():
        raise _option_error(
            str(path),
            "K405",
            f"there is no {CELL_FILE}",
            f"describe the cell in a {CELL_FILE} beside the domain",
        )
    cell = load_cell(path)
    if not cell.operations:
        hint = (
            "say what the arm does in a step under `operations:`, such as pick(Item, Place): "
            "{at: Place}"
        )
        raise _option_error(cell.path, "K405", "the cell declares no operations", hint)
    return cell


def _option_error(where: str, code: str, said: str, hint: str) -> InvalidInput:
    return InvalidInput([Diagnostic(Source(where), code, said, hint)])
