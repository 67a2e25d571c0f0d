"""`cellwright explain`: why there is no plan, or why a step is in a plan."""

from pathlib import Path
from typing import Annotated

from cellwright.engine.faces.cli.answers import Answer, Form, give
from cellwright.engine.faces.cli.declared import Argument
from cellwright.engine.faces.cli.exits import GAVE_UP, INTERRUPTED
from cellwright.engine.faces.cli.idle import refuse_idle
from cellwright.engine.faces.cli.options import Command, Expansions, Format, Goals, TimeLimit


def explain(
    target: Annotated[str, Argument(help="a problem; or, with STEP, a plan in JSON")],
    step: Annotated[int | None, Argument(help="the number of a step of the plan")] = None,
    goals: Goals = "",
    command: Command = "",
    format: Format = Form.TEXT,
    time_limit: TimeLimit = None,
    expansions: Expansions = 1_000_000,
) -> None:
    """Explain why TARGET has no plan and which changes would allow one; or why STEP is in the plan TARGET."""
    if step is None:
        give(lambda: _problem(target, goals, command, time_limit, expansions), format)
    refuse_idle({"--goals": goals, "--command": command}, "on a step: the plan contains its goals")
    give(lambda: _step(Path(target), step), format)


def _problem(target: str, goals: str, command: str, time_limit: float | None, expansions: int) -> Answer:
    from cellwright.engine.faces.cli.interruption import Interruption
    from cellwright.engine.formats.report.explanation import explanation as text
    from cellwright.engine.formats.report.explanation import explanation_entry
    from cellwright.engine.pipelines import explanation, planning
    from cellwright.engine.stages.planning import Limits

    with Interruption(time_limit) as interrupted:
        problem = planning.problem_of(target, goals, command)
        found = explanation.explain(problem, Limits(expansions=expansions, interrupted=interrupted))
    code = INTERRUPTED if interrupted.heard else GAVE_UP if found.status == "unknown" else 0
    return Answer(found.status, explanation_entry(found), lambda: text(found), code)


def _step(file: Path, number: int) -> Answer:
    from cellwright.engine.formats.report.explanation import step_entry, step_reason
    from cellwright.engine.pipelines.explanation.steps import why
    from cellwright.engine.pipelines.planning import plan_in
    from cellwright.engine.stages.grounding import ground

    problem, plan = plan_in(file)
    found = why(ground(problem), plan, number, str(file))
    return Answer("ok", step_entry(found), lambda: step_reason(found))
