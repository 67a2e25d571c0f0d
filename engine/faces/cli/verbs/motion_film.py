"""The verb `motion play`: a film of the motions of a plan, or of a run from its journal."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cellwright.engine.faces.cli.output.answer_output import VerbAnswer
from cellwright.engine.faces.cli.process.exit_codes import exit_code
from cellwright.engine.formats import report
from cellwright.engine.formats.report import rich_parts
from cellwright.engine.model.outcome import Found
from cellwright.engine.model.run_protocol import BODIES_SEEN
from cellwright.engine.pipelines import execution, motion, planning
from cellwright.engine.plugins import geometry_backend
from cellwright.kb import loader
from cellwright.kb import store as kb_store

if TYPE_CHECKING:
    from cellwright.engine.pipelines.motion.seen_bodies import SeenBody
    from cellwright.engine.pipelines.motion.step_film import FilmShot
    from cellwright.kb.model.cell_model import Cell
    from cellwright.kb.model.planning_problem import Problem
    from cellwright.kb.terms import Atom, Function


def film_of_plan(
    target: str, seed: int, store: str, output: Path, every_s: float, seen: tuple[float, float]
) -> VerbAnswer:
    """The film of the plan of TARGET."""
    from cellwright.engine.stages.planning import SearchLimits

    problem = planning.problem_of(target)
    cell = loader.cell_of_problem(problem)
    posed_plan = motion.plan_with_poses(
        problem,
        cell,
        geometry_backend(),
        lambda each: planning.plan_for_objective(each, SearchLimits(seed=seed)),
        seed,
        store,
    )
    outcome = posed_plan.moving.run.outcome
    if not isinstance(outcome, Found):
        message = f"There is nothing to play: {outcome.reason}."
        return VerbAnswer(
            report.outcome_status(outcome),
            {"reason": outcome.reason},
            lambda: rich_parts.Text(message),
            exit_code(outcome),
        )
    semantics = planning.PlanGate().semantics(posed_plan.moving.problem)
    takes = motion.takes_of_plan(semantics, cell, outcome.plan, posed_plan.moving.steps)
    return _write_film(list(motion.shots_of_film(takes, every_s)), output, every_s, seen)


def film_of_run(
    run: str, store: str, seed: int, output: Path, every_s: float, seen: tuple[float, float]
) -> VerbAnswer:
    """The film of a run, from its journal. Raises `InvalidInput` if there is no such run."""
    with kb_store.Journal(store) as journal:
        about: Any = journal.known(run).document
        journal.require_whole(run, unchained=True)
        problem: Problem = planning.problem_of(
            str(about["target"]), str(about["goals"]), str(about["command"])
        )
        cell: Cell = loader.cell_of(str(about["target"]))
        semantics = planning.PlanGate().semantics(problem)
        lines = list(journal.lines(run, kinds=("done", "world")))
        walk = motion.PlanWalk(
            semantics, motion.with_seen(cell, _obstacles_met(lines, cell)), geometry_backend(), seed
        )
        takes = motion.takes_of_run(walk, semantics.initial(), _told_changes(lines))
        return _write_film(list(motion.shots_of_film(takes, every_s)), output, every_s, seen)


def _obstacles_met(lines: Any, cell: "Cell") -> "list[SeenBody]":
    """What the arm has met in a run: it is shown from the beginning on."""
    bodies = {
        name: at for line in lines for name, at in line.content.get("bodies", {}).items() if at
    }
    return list(motion.seen_in({BODIES_SEEN: bodies}, cell)[0])


def _told_changes(lines: Any) -> "Iterator[tuple[Function | None, list[Atom], list[Atom]]]":
    """What was done, or corrected, by each record: the step, what it added and what it ended."""
    for line in lines:
        content = line.content
        adds, ends = (
            [execution.read_ground_atom(atom_content) for atom_content in content.get(key, ())]
            for key in ("adds", "ends")
        )
        yield (
            (execution.read_ground_atom(content["action"]) if "action" in content else None),
            adds,
            ends,
        )


def _write_film(
    shots: "list[FilmShot]", output: Path, every_s: float, seen: tuple[float, float]
) -> VerbAnswer:
    """The film in its file or files."""
    if not shots:
        return VerbAnswer(
            "found", {"seconds": 0, "files": []}, lambda: rich_parts.Text("Nothing moves.")
        )
    lasts = shots[-1].at_s
    if output.suffix == ".png":
        shots = motion.thin_shots(shots, every_s)
        files = [output.with_stem(f"{output.stem}-{n:04d}") for n in range(1, len(shots) + 1)]
        for file, picture in zip(files, report.as_pngs(shots, *seen), strict=True):
            file.write_bytes(picture)
        film_text = f"{len(files)} pictures of {lasts:.0f} s: {files[0]} to {files[-1].name}"
    else:
        files = [output]
        output.write_text(report.film_gltf(shots), encoding="utf-8")
        film_text = f"{lasts:.0f} s in {output}"
    return VerbAnswer(
        "found",
        {"seconds": round(lasts, 3), "files": [str(file) for file in files]},
        lambda: rich_parts.Text(film_text),
    )
