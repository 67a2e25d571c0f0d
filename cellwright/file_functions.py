"""Files: PDDL, QIF, new domains, devices, schemas, golden plans, the usual form of files."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from cellwright.engine.formats import interop, report
from cellwright.engine.model.outcome import Found
from cellwright.engine.pipelines import planning
from cellwright.kb import loader
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.library_base import Name, Target, load, name_of
from cellwright.plan_functions import Planned, plan_of

if TYPE_CHECKING:
    from cellwright.engine.authoring.layout import ArrangedFiles
    from cellwright.engine.authoring.testing.golden_files import GoldenComparison
    from cellwright.engine.formats.interop.pddl import PddlProblem
    from cellwright.kb.loader.device_uses import DeviceHead

FileKind = Literal[
    "domain", "problem", "plan", "device", "cell", "arm", "faults", "contacts", "scene", "events"
]


def read_pddl(domain: Name, problem: Name) -> "PddlProblem":
    """A PDDL task; its `problem` is planned like any other.

    Raises `InvalidInput` for what is not supported, with its place, and for a task with times.
    """
    if interop.has_times(Path(domain), Path(problem)):
        said = "the task has times: durative actions or timed literals"
        hint = "read_timed_pddl reads it, and plan_timed plans it"
        raise InvalidInput([Diagnostic(Source(str(domain)), "K802", said, hint)])
    return interop.read_pddl_task(Path(domain), Path(problem))


def read_pddl_plan(task: "PddlProblem", file: Name) -> Planned:
    """A plan for a PDDL task, in the format of the planning competitions.

    `validate` checks it. Raises `InvalidInput`.
    """
    return Planned(
        report.PlanAnswer(planning.Run(Found(interop.read_plan(task, Path(file)))), task.problem)
    )


def write_pddl_plan(task: "PddlProblem", plan: Planned) -> str:
    """The plan for a PDDL task as text, in the format of the planning competitions.

    Raises `InvalidInput` without a plan.
    """
    return interop.write_plan(task, plan_of(plan)[1])


def export_pddl(
    target: Target, folder: Name, *, goals: str = "", command: str = "", ground: bool = False
) -> tuple[Path, Path]:
    """Write a problem as domain.pddl and problem.pddl for any planner; the two files.

    Raises `InvalidInput`.
    """
    return interop.write_pddl_files(
        interop.export_problem(load(target, goals, command), lifted=not ground), Path(folder)
    )


def export_behaviour_tree(plan: "Planned | str | PathLike[str]") -> str:
    """A plan as a behaviour tree, in the XML of BehaviorTree.CPP 4.

    Raises `InvalidInput` for a plan that is not right.
    """
    from cellwright.engine.pipelines.planning.plan_files import check_plan

    problem, made, _, name = plan_of(plan)
    if wrong := check_plan(problem, made, name):
        raise InvalidInput(wrong)
    return interop.write_behaviour_tree(problem.domain, made)


def export_qif(target: Target) -> str:
    """The points to measure of a problem as a QIF document."""
    return interop.as_qif(load(target))[0]


@dataclass(frozen=True)
class Imported:
    """A problem that was written: its file, how many points it has, and what was left out or
    doubtful.
    """

    file: Path
    points: int
    diagnostics: "tuple[Diagnostic, ...]"


def import_points(
    file: Name,
    output: Name,
    *,
    domain: str = "bulkhead",
    unit: Literal["mm", "cm", "m", "in"] = "mm",
    edge_distance: float | None = None,
) -> Imported:
    """Write a problem with the points of a QIF document or a CSV table; `domain` chooses tools.
    Raises `InvalidInput`, `OSError`.

    `unit` is that of a file that names none, and of `edge_distance`, by which points stay away from
    the edges of faces.
    """
    source, target = Path(file), Path(output)
    table = source.suffix.lower() == ".csv"
    inspection, _, text = interop.import_file(source, domain, unit, edge_distance, table)
    target.write_text(text, "utf-8")
    return Imported(target, len(inspection.points), interop.inspection_remarks(inspection, source))


def init(folder: Name, devices: Sequence[str] = ()) -> tuple[Path, ...]:
    """Write a small domain into a new folder, put together from `devices` if some are named;
    its files. Raises `InvalidInput`.
    """
    from cellwright.engine.authoring.starter import create_domain, create_with

    return tuple(create_with(Path(folder), devices)[0] if devices else create_domain(Path(folder)))


def devices(beside: Name = ".") -> "tuple[DeviceHead, ...]":
    """The devices that come with Cellwright, and those of the domain in the folder `beside`."""
    return tuple(loader.all_devices(Path(beside)))


def schema(kind: FileKind) -> Mapping[str, Any]:
    """The JSON Schema of a kind of file."""
    from cellwright.kb.schema import json_schema

    return json_schema(kind)


def compare_golden(target: Target) -> "tuple[GoldenComparison, ...]":
    """Plan every problem of a domain again and compare the answers with the accepted ones.

    Raises `InvalidInput`.
    """
    from cellwright.engine.authoring.testing.golden_files import compare_all

    return tuple(compare_all(name_of(target)))


def format_files(paths: Sequence[Name], *, write: bool = True) -> "ArrangedFiles":
    """Give files, and all of folders, their usual form; with `write` off, only say which differ."""
    from cellwright.engine.authoring.layout import arrange_files

    return arrange_files([Path(fspath(path)) for path in paths], write)
