"""`cellwright revise`: repair a plan after the world has changed during its execution."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cellwright.engine.faces.cli.answers import Answer, Form, give
from cellwright.engine.faces.cli.declared import Argument, Option
from cellwright.engine.faces.cli.exits import INTERRUPTED, exit_code
from cellwright.engine.faces.cli.options import Expansions, Format, Seed, TimeLimit


def revise(
    file: Annotated[Path, Argument(help="a plan in JSON")],
    done: Annotated[str, Option(help="the steps that are done, such as 1..4, 7")] = "",
    holds: Annotated[str, Option(help="facts that hold unexpectedly")] = "",
    gone: Annotated[str, Option(help="facts that unexpectedly do not hold")] = "",
    lost: Annotated[
        str, Option(help="tools and resources that can no longer be used, such as us_probe")
    ] = "",
    both: Annotated[bool, Option("--both", help="always replan too, and take the cheaper plan")] = False,
    time_limit: TimeLimit = None,
    expansions: Expansions = 1_000_000,
    seed: Seed = 0,
    format: Format = Form.TEXT,
) -> None:
    """Repair the plan in FILE for the observed state, or replan, whichever is cheaper."""
    observed = Observations(done, holds, gone, lost)
    give(lambda: _revise(file, observed, both, (time_limit, expansions, seed)), format)


@dataclass(frozen=True, slots=True)
class Observations:
    """What is known of the world, as it is given: steps done, facts that hold or do not hold, and what is lost."""

    done: str
    holds: str
    gone: str
    lost: str


def _revise(file: Path, given: Observations, both: bool, work: tuple[float | None, int, int]) -> Answer:
    from cellwright.engine.faces.cli.interruption import Interruption
    from cellwright.engine.formats.report import json, revised
    from cellwright.engine.pipelines.planning import plan_in
    from cellwright.engine.pipelines.revision.now import revised_now
    from cellwright.engine.pipelines.troubleshooting.recovery import in_sequence
    from cellwright.engine.stages.planning import Limits

    seconds, expansions, seed = work
    with Interruption(seconds) as interrupted:
        problem, plan = plan_in(file)
        limits = Limits(expansions, interrupted=interrupted, seed=seed)
        found, follows = revised_now(
            problem, plan, (given.done, given.holds, given.gone, given.lost), limits, both, in_sequence
        )
    content = {**json.outcome(found.outcome, found.problem), "revision": revised.entry(found, follows)}
    code = INTERRUPTED if interrupted.heard else exit_code(found.outcome)
    return Answer(json.status(found.outcome), content, lambda: revised.text(found, follows), code)
