"""The verb `export`: writes problems as PDDL, plans as behaviour trees, points as QIF."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from cellwright.engine.faces.cli.options.shared_options import Command, Format, Goals, Ground
from cellwright.engine.faces.cli.output.answer_output import AnswerForm, VerbAnswer, give_answer
from cellwright.engine.faces.cli.process.exit_codes import FINDINGS
from cellwright.engine.faces.cli.wrong_options import refuse_idle
from cellwright.engine.formats import interop
from cellwright.engine.formats.report import rich_parts
from cellwright.engine.pipelines import planning
from cellwright.kb.diagnostics import escape_controls


class Language(StrEnum):
    """The languages in which a problem or a plan can be written."""

    PDDL = "pddl"
    BT = "bt"
    QIF = "qif"


def export_target(
    language: Annotated[
        Language,
        Argument(
            help="pddl for a problem, bt for the behaviour tree of a plan, qif for the points to "
            "measure"
        ),
    ],
    target: Annotated[
        str, Argument(metavar="TARGET|PLAN", help="what `plan` takes; for bt a plan in JSON")
    ],
    goals: Goals = "",
    command: Command = "",
    ground: Ground = False,
    output: Annotated[
        Path | None,
        Option(
            "--output",
            "-o",
            help="the folder to write into, else this one; for bt and qif a file, else it is "
            "printed",
        ),
    ] = None,
    format: Format = AnswerForm.TEXT,
) -> None:
    """Write TARGET as domain.pddl and problem.pddl, so that any PDDL planner can solve it, PLAN as
    a behaviour tree, or points.

    Behaviour trees are in the XML of BehaviorTree.CPP version 4. The points to measure are written
    as a QIF document.
    """
    if language is Language.QIF:
        refuse_idle(
            {"--goals": goals, "--command": command, "--ground": ground},
            "with qif, which writes all points",
        )
        give_answer(lambda: _export_qif(target, output), format)
    if language is Language.BT:
        idle = {"--goals": goals, "--command": command, "--ground": ground}
        refuse_idle(idle, "with bt, which takes a plan")
        give_answer(lambda: _behaviour_tree(Path(target), output), format)
    give_answer(lambda: _export_pddl(target, goals, command, ground, output or Path()), format)


def _behaviour_tree(file: Path, output: Path | None) -> VerbAnswer:
    problem, plan = planning.plan_in(file)
    if plan_diagnostics := planning.check_plan(problem, plan, str(file)):
        return VerbAnswer("invalid", code=FINDINGS, diagnostics=tuple(plan_diagnostics))
    tree = interop.write_behaviour_tree(problem.domain, plan)
    if output is None:
        return VerbAnswer("ok", raw=tree)
    output.write_text(escape_controls(tree), "utf-8")
    return VerbAnswer(
        "ok", {"file": str(output), "steps": len(plan.steps)}, lambda: rich_parts.Text(str(output))
    )


def _export_qif(target: str, output: Path | None) -> VerbAnswer:
    text, count, told = interop.as_qif(planning.problem_of(target))
    if output is None:
        return VerbAnswer("ok", raw=text, diagnostics=told)
    output.write_text(escape_controls(text), "utf-8")
    content = {"file": str(output), "points": count, "left_out": len(told)}
    return VerbAnswer(
        "ok", content, lambda: rich_parts.Text(f"{output}: {count} points"), diagnostics=told
    )


def _export_pddl(target: str, goals: str, command: str, ground: bool, output: Path) -> VerbAnswer:
    exported = interop.export_problem(
        planning.problem_of(target, goals, command), lifted=not ground
    )
    domain, problem = interop.write_pddl_files(exported, output)
    content = {
        "domain": str(domain),
        "problem": str(problem),
        "lifted": exported.lifted,
        "why_ground": exported.why_ground,
    }
    pddl_text = f"{domain}\n{problem}"
    if exported.why_ground:
        pddl_text += (
            "\nwritten without variables, because the form with variables does not cover "
            f"{exported.why_ground}"
        )
    return VerbAnswer("ok", content, lambda: rich_parts.Text(pddl_text))
