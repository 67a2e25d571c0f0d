"""`cellwright prepare`: plan a set of problems before the plans are needed."""

from typing import TYPE_CHECKING, Annotated

from cellwright.engine.faces.cli.answers import Answer, Form, give
from cellwright.engine.faces.cli.declared import Argument
from cellwright.engine.faces.cli.exits import BAD_INPUT, GAVE_UP, INTERRUPTED, LIMIT
from cellwright.engine.faces.cli.options import Cluster, Expansions, Format, Jobs, Library, Seed, TimeLimit
from cellwright.engine.faces.cli.working import crew_asked, progress_of, refuse_both

if TYPE_CHECKING:
    from cellwright.engine.pipelines.units import Crew


UNITS = (  # what planning a problem needs, also what is loaded only when it is needed
    "cellwright.engine.pipelines.preparation.problem",
    "cellwright.engine.stages.planning.forward",
    "cellwright.kb.asp.compiled",
    "cellwright.kb.asp.trial",
    "cellwright.kb.loader.command",
    "cellwright.kb.loader.domain",
    "cellwright.kb.loader.loading",
    "cellwright.kb.loader.problem",
    "cellwright.kb.loader.uses",
    "cellwright.kb.schema.device",
    "cellwright.kb.schema.domain",
    "cellwright.kb.schema.problem",
    "cellwright.kb.store.units",
)


def prepare(
    target: Annotated[
        str, Argument(help="a domain (all its problems), a folder of problems, or one problem")
    ],
    store: Library,
    jobs: Jobs = 0,
    cluster: Cluster = "",
    time_limit: TimeLimit = None,
    expansions: Expansions = 1_000_000,
    seed: Seed = 0,
    format: Format = Form.TEXT,
) -> None:
    """Plan every problem of TARGET, sequence its measurements, and fill the store before plans are needed."""
    refuse_both(jobs, cluster)
    give(
        lambda: _prepare(target, store, crew_asked(jobs, cluster, UNITS), time_limit, expansions, seed),
        format,
    )


def _prepare(
    target: str, store: str, crew: "Crew", seconds: float | None, expansions: int, seed: int
) -> Answer:
    from cellwright.engine.faces.cli.interruption import Interruption
    from cellwright.engine.formats.report import prepared
    from cellwright.engine.pipelines.preparation import prepare as prepare_all
    from cellwright.engine.pipelines.preparation.targets import problems_of
    from cellwright.engine.stages.planning import Limits

    paths = problems_of(target)
    with Interruption(seconds) as interrupted, progress_of("planning") as progress:
        limits = Limits(expansions, interrupted=interrupted, seed=seed)
        found = prepare_all(paths, store, limits, crew, progress)
    statuses = {each.status for each in found.problems}
    code = INTERRUPTED if interrupted.heard else BAD_INPUT if "bad input" in statuses else 0
    if not code and "gave up" in statuses:
        code = LIMIT if interrupted() else GAVE_UP
    diagnostics = tuple(dict.fromkeys(d for each in found.problems for d in each.diagnostics))
    return Answer(
        "ok" if not code else "incomplete",
        prepared.content(found),
        lambda: prepared.text(found),
        code,
        diagnostics,
    )
