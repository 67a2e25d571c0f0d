"""`cellwright revise`: repair a plan after the world has changed during its execution."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from engine.faces.cli.answers import Answer, Form, give
from engine.faces.cli.exits import INTERRUPTED, exit_code
from engine.faces.cli.options import Expansions, Format, Seed, TimeLimit

if TYPE_CHECKING:
    from rich.console import RenderableType

    from engine.pipelines.revision import PlanRevision


def revise(
    file: Annotated[Path, typer.Argument(help="a plan in JSON")],
    done: Annotated[str, typer.Option(help="the steps that are done, such as 1..4, 7")] = "",
    holds: Annotated[str, typer.Option(help="facts that hold unexpectedly")] = "",
    gone: Annotated[str, typer.Option(help="facts that unexpectedly do not hold")] = "",
    both: Annotated[
        bool, typer.Option("--both", help="always replan too, and take the cheaper plan")
    ] = False,
    time_limit: TimeLimit = None,
    expansions: Expansions = 1_000_000,
    seed: Seed = 0,
    format: Format = Form.TEXT,
) -> None:
    """Repair the plan in FILE for the observed state, or replan, whichever is cheaper."""
    give(lambda: _revise(file, done, (holds, gone), both, (time_limit, expansions, seed)), format)


def _revise(
    file: Path, done: str, facts: tuple[str, str], both: bool, work: tuple[float | None, int, int]
) -> Answer:
    from engine.faces.cli.interruption import Interruption
    from engine.formats.report import json
    from engine.pipelines.revision import Course
    from engine.pipelines.revision import revise as revise_plan
    from engine.pipelines.revision.observing import expected, observed, read_facts, read_steps
    from engine.stages.planning import Limits
    from kb.loader.plan import load_plan

    seconds, expansions, seed = work
    with Interruption(seconds) as interrupted:
        problem, plan = load_plan(file)
        holds, gone = (
            read_facts(text, problem.domain, f"--{name}") for text, name in zip(facts, NAMES, strict=True)
        )
        steps = read_steps(done, [step.id for step in plan.steps])
        course = Course.of(problem, plan)
        state = observed(course, expected(course, steps), holds, gone)
        found = revise_plan(
            course, steps, state, Limits(expansions, interrupted=interrupted, seed=seed), both
        )
    content = {**json.outcome(found.outcome, found.problem), "revision": _entry(found)}
    code = INTERRUPTED if interrupted.heard else exit_code(found.outcome)
    return Answer(json.status(found.outcome), content, lambda: _text(found), code)


NAMES = ("holds", "gone")


def _entry(found: "PlanRevision") -> dict[str, Any]:
    parts = {"kept": found.kept, "dropped": found.dropped, "added": found.added}
    return {
        "way": found.way,
        **{name: [str(step.operator) for step in steps] for name, steps in parts.items()},
        "repair_cost": found.repair_cost,
        "replanning_cost": found.replanning_cost,
    }


def _text(found: "PlanRevision") -> "RenderableType":
    from rich.console import Group
    from rich.text import Text

    from engine.formats.report import text

    said = [
        f"{found.way}: {len(found.kept)} steps kept, {len(found.dropped)} dropped, {len(found.added)} added"
    ]
    said += [f"  - {step.operator}" for step in found.dropped]
    said += [f"  + {step.operator}" for step in found.added]
    if found.repair_cost is not None and found.replanning_cost is not None:
        said.append(f"repair costs {found.repair_cost}, replanning {found.replanning_cost}")
    return Group(text.outcome(found.outcome, found.problem), Text("\n".join(said)))
