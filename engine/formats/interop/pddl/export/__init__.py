"""PDDL out: a problem is written as a domain and a problem file; its plans are read back.

The export is lifted: operators keep their parameters, deductive operators become effects,
constraints over several variables become static facts, compound terms become objects, derived
predicates are unfolded (recursive ones become axioms), the workflow becomes counters, and the
initial state holds its defaults. If lifted PDDL cannot express a problem (deduction that leads back
to itself, arithmetic inside a disjunction), the ground task is exported. So is one with quantities,
which become numeric fluents. Durations and resources are left out.
"""

from dataclasses import dataclass
from pathlib import Path

from cellwright.engine.formats.interop.pddl.export.export_statics import NotLiftable
from cellwright.engine.formats.interop.pddl.export.exported_plans import GroundPlans, LiftedPlans
from cellwright.engine.formats.interop.pddl.export.flat_problem import flatten_problem
from cellwright.engine.formats.interop.pddl.export.ground_export import GroundWriter
from cellwright.engine.formats.interop.pddl.export.lifted_writer import LiftedWriter
from cellwright.engine.model.ground_task import GroundTask
from cellwright.engine.stages.grounding import ground
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.files import read_file
from cellwright.kb.model.plan_model import Plan
from cellwright.kb.model.planning_problem import Problem


@dataclass(frozen=True, slots=True)
class PddlText:
    """A domain file and a problem file.

    `why_ground` names what lifted PDDL could not express; it is empty otherwise.
    """

    domain: str
    problem: str
    plans: LiftedPlans | GroundPlans
    why_ground: str = ""

    @property
    def lifted(self) -> bool:
        """Whether operators kept their parameters."""
        return isinstance(self.plans, LiftedPlans)


def pddl_text_of(problem: Problem, task: GroundTask, lifted: bool = True) -> PddlText:
    """A problem as PDDL. `task` is its ground task; it is written if `lifted` is False, for
    planners that only read STRIPS.
    """
    why = "quantities" if problem.domain.quantities else ""
    if lifted and not why:
        try:
            flat = flatten_problem(problem, task)
            writer = LiftedWriter(flat)
            return PddlText(
                writer.domain(), writer.problem(), LiftedPlans(flat, writer.names, problem, task)
            )
        except NotLiftable as error:
            why = str(error)
    ground = GroundWriter(problem.name, task)
    return PddlText(ground.domain(), ground.problem(), GroundPlans(ground.actions, task), why)


def import_plan(exported: PddlText, text: str, name: str = "plan") -> Plan:
    """A plan that another planner found for an export, as a sequence of our operators.

    Raises `InvalidInput`.
    """
    return exported.plans.read(text, name)


DOMAIN, PROBLEM = "domain.pddl", "problem.pddl"
EXPORT_SIGNATURE = "; written by cellwright export pddl"


def export_problem(problem: Problem, lifted: bool = True) -> PddlText:
    """A problem as PDDL, lifted if lifted PDDL can express it. Raises `InvalidInput`."""
    return pddl_text_of(problem, ground(problem), lifted)


def write_pddl_files(text: PddlText, folder: Path) -> tuple[Path, Path]:
    """Write both files into a folder, which is made if necessary. Only earlier exports are
    overwritten.

    Raises `InvalidInput`.
    """
    files = (folder / DOMAIN, folder / PROBLEM)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if foreign := [file for file in files if not _is_our_file(file)]:
            raise InvalidInput(
                [
                    Diagnostic(Source(str(file)), "K403", _NOT_OVERWRITTEN, _FOLDER_HINT)
                    for file in foreign
                ]
            )
        for file, content in zip(files, (text.domain, text.problem), strict=True):
            file.write_text(f"{EXPORT_SIGNATURE}\n{content}", "utf-8")
    except OSError as error:
        message = f"cannot be written: {error.strerror}"
        raise InvalidInput(
            [Diagnostic(Source(str(folder)), "K415", message, _FOLDER_HINT)]
        ) from None
    return files


_NOT_OVERWRITTEN = "this file was not written by `export`, so it is not overwritten"
_FOLDER_HINT = "name another folder with --output"


def _is_our_file(file: Path) -> bool:
    return not file.exists() or file.read_bytes().startswith(EXPORT_SIGNATURE.encode())


def read_exported_plan(problem: Problem, file: Path, lifted: bool = True) -> Plan:
    """The plan that a planner found for the export of a problem, as a sequence of our operators.

    Raises `InvalidInput`.
    """
    return import_plan(export_problem(problem, lifted), read_file(file).text, str(file))
