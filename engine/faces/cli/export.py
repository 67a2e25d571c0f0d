"""`cellwright export`: problems in the languages of other planners."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from engine.faces.cli.answers import Answer, Form, give
from engine.faces.cli.options import Command, Format, Goals, Ground, Target


class Language(StrEnum):
    """The languages in which a problem can be written."""

    PDDL = "pddl"


def export(
    language: Annotated[Language, typer.Argument(help="what to write")],
    target: Target,
    goals: Goals = "",
    command: Command = "",
    ground: Ground = False,
    output: Annotated[Path, typer.Option("--output", "-o", help="the folder to write into")] = Path(),
    format: Format = Form.TEXT,
) -> None:
    """Write TARGET as domain.pddl and problem.pddl, so that any PDDL planner can solve it."""
    assert language is Language.PDDL  # the only one
    give(lambda: _export(target, goals, command, ground, output), format)


def _export(target: str, goals: str, command: str, ground: bool, output: Path) -> Answer:
    from rich.text import Text

    from engine.formats.interop.pddl import files as pddl
    from engine.pipelines import planning

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
        said += (
            f"\nwritten without variables, because PDDL with variables cannot express {exported.why_ground}"
        )
    return Answer("ok", content, lambda: Text(said))
