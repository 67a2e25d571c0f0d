"""What is so in a simulated cell and nobody knows: bodies that its model has not, and facts that are otherwise than is believed.

    --option obstacles=FILE    # a `cell.yaml` with the bodies under `fixtures`
    --option really=FACTS      # "at(brick, top); -at(brick, shelf)": what is true, and behind a `-` what is not

What the arm has met is known from then on.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from cellwright.engine.model.execution import SEEN
from cellwright.engine.pipelines.moves.recognising import putting
from cellwright.engine.pipelines.moves.seen import look_at, with_seen
from cellwright.engine.pipelines.revision.observing import corrected, read_facts
from cellwright.engine.pipelines.simulation import Dynamics
from cellwright.engine.stages.geometry.world.model import World
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.loader.cell import load_cell
from cellwright.kb.model.cell import Body, Cell
from cellwright.kb.model.problem import Problem
from cellwright.kb.targets import CELL_FILE
from cellwright.kb.terms import Atom

OPTIONS = ("obstacles", "really")
NAMED = "write `cell: NAME`, and below `fixtures:` the bodies, as in a cell.yaml"


@dataclass
class Unknown:
    """The unknown in one cell. `true` are facts of the beginning that nobody knows, `false` those that are believed instead."""

    cell: Cell
    bodies: Mapping[str, Body] = field(default_factory=dict)
    true: frozenset[Atom] = frozenset()
    false: frozenset[Atom] = frozenset()
    met: set[str] = field(default_factory=set)

    @property
    def names(self) -> frozenset[str]:
        """The bodies that nobody knows of, or not where they are, as long as the arm has not met them."""
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
        world = World.of(self.whole)
        return with_seen(
            self.cell, [look_at(world, name, boxed=True) for name in sorted(self.met & {*self.bodies})]
        )

    def believed(self, facts: Collection[Atom]) -> frozenset[Atom]:
        """What is believed where some facts are true."""
        now = frozenset(facts)
        hidden = self.true & now if self._misplaced - self.met else frozenset()
        return (now - hidden) | self.false if hidden else now

    def meets(self, name: str, world: World) -> dict[str, Any]:
        """The arm has met a body, where it is in a world: what a reply tells of that."""
        self.met.add(name)
        return {SEEN: {name: look_at(world, name, boxed=name in self.bodies).entry()}}

    @property
    def _misplaced(self) -> frozenset[str]:
        moved = self.true | self.false
        return frozenset(name for name in self.cell.bodies if moved and putting(self.cell, moved, (name,)))


def unknown_of(options: Mapping[str, str], problem: Problem) -> Unknown | None:
    """What the options of a driver hide; None if they hide nothing. Raises `InvalidInput`."""
    if not any(options.get(each) for each in OPTIONS):
        return None
    cell = moving_cell(problem.domain.path)
    bodies = _bodies(options["obstacles"], cell) if options.get("obstacles") else {}
    start = Dynamics(problem).start().facts
    now = frozenset(_really(options["really"], problem, start)) if options.get("really") else start
    return Unknown(cell, bodies, now - start, start - now)


def _really(text: str, problem: Problem, start: frozenset[Atom]) -> tuple[Atom, ...]:
    parts = [each.strip() for each in text.split(";") if each.strip()]
    holds = ", ".join(each for each in parts if not each.startswith("-"))
    gone = ", ".join(each[1:].strip() for each in parts if each.startswith("-"))
    read = [read_facts(each, problem.domain, "--option really") for each in (holds, gone)]
    return corrected(Dynamics(problem), start, *read)


def _bodies(file: str, cell: Cell) -> Mapping[str, Body]:
    read = _read(Path(file))
    found, others = read.bodies, {*read.arms, *read.places, *read.zones}
    if others:
        said = f"it has more than bodies: {', '.join(sorted(others))}"
        raise _refused(file, "K405", said, "keep only what stands in the way, under `fixtures`")
    if not found:
        raise _refused(file, "K405", "there is no body in it", NAMED)
    for name, body in found.items():
        if not body.shapes:
            raise _refused(
                file, "K405", f"'{name}' has no shapes, so nothing can touch it", "give it `shapes`"
            )
        if name in cell.bodies or name in cell.arms or name in cell.frames:
            hint = "choose another name; say where a known body is with --option really=FACTS"
            raise _refused(file, "K104", f"the cell has a '{name}' already", hint)
    return found


def _read(file: Path) -> Cell:
    """The cell in a file of obstacles. Raises `InvalidInput`, for an empty file with what belongs into it."""
    if file.is_file() and not file.read_bytes().strip():
        raise _refused(str(file), "K002", "the file is empty", NAMED)
    return load_cell(file)


def moving_cell(domain: str) -> Cell:
    """The cell beside a domain file, in which an arm moves. Raises `InvalidInput`."""
    path = Path(domain).with_name(CELL_FILE)
    if not domain or not path.is_file():
        raise _refused(
            str(path),
            "K405",
            f"there is no {CELL_FILE}",
            f"describe the cell in a {CELL_FILE} beside the domain",
        )
    cell = load_cell(path)
    if not cell.operations:
        hint = "say what the arm does in a step under `operations:`, such as pick(Item, Place): {at: Place}"
        raise _refused(cell.path, "K405", "the cell declares no operations", hint)
    return cell


def _refused(where: str, code: str, said: str, hint: str) -> InvalidInput:
    return InvalidInput([Diagnostic(Source(where), code, said, hint)])
