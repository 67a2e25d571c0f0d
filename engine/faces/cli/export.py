"""`cellwright export`: problems and plans in the languages of other systems."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

from cellwright.engine.faces.cli.answers import Answer, Form, give
from cellwright.engine.faces.cli.declared import Argument, Option
from cellwright.engine.faces.cli.idle import refuse_idle
from cellwright.engine.faces.cli.options import Command, Format, Goals, Ground


class Language(StrEnum):
    """The languages in which a problem or a plan can be written."""

    PDDL = "pddl"
    BT = "bt"
    QIF = "qif"


def export(
    language: Annotated[
        Language,
        Argument(
            help="pddl for a problem, bt for the behaviour tree of a plan, qif for the points to measure"
        ),
    ],
    target: Annotated[str, Argument(metavar="TARGET|PLAN", help="what `plan` takes; for bt a plan in JSON")],
    goals: Goals = "",
    command: Command = "",
    ground: Ground = False,
    output: Annotated[
        Path | None,
        Option(
            "--output",
            "-o",
            help="the folder to write into, else this one; for bt and qif a file, else it is printed",
        ),
    ] = None,
    format: Format = Form.TEXT,
) -> None:
    """Write TARGET as domain.pddl and problem.pddl, so that any PDDL planner can solve it, PLAN as a behaviour tree, or points.

    Behaviour trees are in the XML of BehaviorTree.CPP version 4. The points to measure are written as a QIF document.
    """
    if language is Language.QIF:
        refuse_idle(
            {"--goals": goals, "--command": command, "--ground": ground}, "with qif, which writes all points"
        )
        give(lambda: _qif(target, output), format)
    if language is Language.BT:
        idle = {"--goals": goals, "--command": command, "--ground": ground}
        refuse_idle(idle, "with bt, which takes a plan")
        give(lambda: _behaviour_tree(Path(target), output), format)
    give(lambda: _pddl(target, goals, command, ground, output or Path()), format)


def _behaviour_tree(file: Path, output: Path | None) -> Answer:
    from rich.text import Text

    from cellwright.engine.faces.cli.exits import FINDINGS
    from cellwright.engine.formats.interop import behaviour_trees
    from cellwright.engine.pipelines import planning
    from cellwright.kb.diagnostics import escaped

    problem, plan = planning.plan_in(file)
    if found := planning.check_plan(problem, plan, str(file)):
        return Answer("invalid", code=FINDINGS, diagnostics=tuple(found))
    tree = behaviour_trees.written(problem.domain, plan)
    if output is None:
        return Answer("ok", raw=tree)
    output.write_text(escaped(tree), "utf-8")
    return Answer("ok", {"file": str(output), "steps": len(plan.steps)}, lambda: Text(str(output)))


def _qif(target: str, output: Path | None) -> Answer:
    from rich.text import Text

    from cellwright.engine.formats.interop.inspections import as_qif
    from cellwright.engine.pipelines import planning
    from cellwright.kb.diagnostics import escaped

    text, count, told = as_qif(planning.problem_of(target))
    if output is None:
        return Answer("ok", raw=text, diagnostics=told)
    output.write_text(escaped(text), "utf-8")
    content = {"file": str(output), "points": count, "left_out": len(told)}
    return Answer("ok", content, lambda: Text(f"{output}: {count} points"), diagnostics=told)


def _pddl(target: str, goals: str, command: str, ground: bool, output: Path) -> Answer:
    from rich.text import Text

    from cellwright.engine.formats.interop.pddl import files as pddl
    from cellwright.engine.pipelines import planning

    exported = pddl.exported(planning.problem_of(target, goals, command), lifted=not ground)
    domain, problem = pddl.write(exported, output)
    content = {
        "domain": str(domain),
        "problem": str(problem),
        "lifted": exported.lifted,
        "why_ground": exported.why_ground,
    }
    said = f"{domain}\n{problem}"
    if exported.why_ground:
        said += f"\nwritten without variables, because the form with variables does not cover {exported.why_ground}"
    return Answer("ok", content, lambda: Text(said))
