"""`cellwright motion play`: a film of a plan, or of a run from its journal."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cellwright.engine.faces.cli.answers import Answer
from cellwright.engine.faces.cli.exits import exit_code

if TYPE_CHECKING:
    from cellwright.engine.pipelines.moves.film import Shot
    from cellwright.engine.pipelines.moves.seen import Seen
    from cellwright.kb.model.cell import Cell
    from cellwright.kb.model.problem import Problem
    from cellwright.kb.terms import Atom, Function


def film_of_plan(
    target: str, seed: int, store: str, output: Path, every_s: float, seen: tuple[float, float]
) -> Answer:
    """The film of the plan of TARGET."""
    from rich.text import Text

    from cellwright.engine.formats.report.json import status
    from cellwright.engine.model.outcome import Found
    from cellwright.engine.pipelines import objective, planning
    from cellwright.engine.pipelines.gate import PlanGate
    from cellwright.engine.pipelines.moves.film import filmed, takes_of_plan
    from cellwright.engine.pipelines.poses.planning import plan_with_poses
    from cellwright.engine.plugins import geometry_backend
    from cellwright.engine.stages.planning import Limits
    from cellwright.kb.loader.cell import cell_of

    problem, cell = planning.problem_of(target), cell_of(target)
    found = plan_with_poses(
        problem, cell, geometry_backend(), lambda each: objective.plan(each, Limits(seed=seed)), seed, store
    )
    outcome = found.moving.run.outcome
    if not isinstance(outcome, Found):
        said = f"There is nothing to play: {outcome.reason}."
        return Answer(status(outcome), {"reason": outcome.reason}, lambda: Text(said), exit_code(outcome))
    semantics = PlanGate().semantics(found.moving.problem)
    takes = takes_of_plan(semantics, cell, outcome.plan, found.moving.steps)
    return _written(list(filmed(takes, every_s)), output, every_s, seen)


def film_of_run(
    run: str, store: str, seed: int, output: Path, every_s: float, seen: tuple[float, float]
) -> Answer:
    """The film of a run, from its journal. Raises `InvalidInput` if there is no such run."""
    from cellwright.engine.pipelines.gate import PlanGate
    from cellwright.engine.pipelines.moves.film import filmed, takes_of_run
    from cellwright.engine.pipelines.moves.seen import with_seen
    from cellwright.engine.pipelines.moves.walking import Walk
    from cellwright.engine.pipelines.planning import problem_of
    from cellwright.engine.plugins import geometry_backend
    from cellwright.kb.loader.cell import cell_of
    from cellwright.kb.store.journal import Journal

    with Journal(store) as journal:
        about: Any = journal.known(run).document
        problem: Problem = problem_of(str(about["target"]), str(about["goals"]), str(about["command"]))
        cell: Cell = cell_of(str(about["target"]))
        semantics = PlanGate().semantics(problem)
        lines = list(journal.lines(run, kinds=("done", "world")))
        walk = Walk(semantics, with_seen(cell, _met(lines, cell)), geometry_backend(), seed)
        takes = takes_of_run(walk, semantics.initial(), _told(lines))
        return _written(list(filmed(takes, every_s)), output, every_s, seen)


def _met(lines: Any, cell: "Cell") -> "list[Seen]":
    """What the arm has met in a run: it is shown from the beginning on."""
    from cellwright.engine.model.execution import SEEN
    from cellwright.engine.pipelines.moves.seen import seen_in

    bodies = {name: at for line in lines for name, at in line.content.get("bodies", {}).items() if at}
    return list(seen_in({SEEN: bodies}, cell)[0])


def _told(lines: Any) -> "Iterator[tuple[Function | None, list[Atom], list[Atom]]]":
    """What was done, or corrected, by each record: the step, what it added and what it ended."""
    from cellwright.engine.pipelines.execution.records import read_atom

    for line in lines:
        content = line.content
        adds, ends = ([read_atom(each) for each in content.get(key, ())] for key in ("adds", "ends"))
        yield (read_atom(content["action"]) if "action" in content else None), adds, ends


def _written(shots: "list[Shot]", output: Path, every_s: float, seen: tuple[float, float]) -> Answer:
    """The film in its file or files."""
    from rich.text import Text

    from cellwright.engine.formats.report import film
    from cellwright.engine.pipelines.moves.film import thinned

    if not shots:
        return Answer("found", {"seconds": 0, "files": []}, lambda: Text("Nothing moves."))
    lasts = shots[-1].at_s
    if output.suffix == ".png":
        shots = thinned(shots, every_s)
        files = [output.with_stem(f"{output.stem}-{n:04d}") for n in range(1, len(shots) + 1)]
        for file, picture in zip(files, film.as_pngs(shots, *seen), strict=True):
            file.write_bytes(picture)
        said = f"{len(files)} pictures of {lasts:.0f} s: {files[0]} to {files[-1].name}"
    else:
        files = [output]
        output.write_text(film.as_gltf(shots), encoding="utf-8")
        said = f"{lasts:.0f} s in {output}"
    return Answer(
        "found", {"seconds": round(lasts, 3), "files": [str(each) for each in files]}, lambda: Text(said)
    )
