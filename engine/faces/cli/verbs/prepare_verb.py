"""The verb `prepare`: plans for a set of problems before they are needed."""

from typing import TYPE_CHECKING, Annotated

from typer import Argument

from cellwright.engine.faces.cli.options.shared_options import (
    Cluster,
    Expansions,
    Format,
    Jobs,
    Library,
    Seed,
    TimeLimit,
)
from cellwright.engine.faces.cli.options.worker_options import crew_asked, progress_of, refuse_both
from cellwright.engine.faces.cli.output.answer_output import AnswerForm, VerbAnswer, give_answer
from cellwright.engine.faces.cli.process.exit_codes import BAD_INPUT, GAVE_UP, INTERRUPTED, LIMIT
from cellwright.engine.faces.cli.process.search_interruption import SearchInterruption
from cellwright.engine.formats import report
from cellwright.kb.diagnostics import Diagnostic, Source

if TYPE_CHECKING:
    from cellwright.engine.pipelines.jobs import WorkCrew


UNITS = (  # what planning a problem needs, also what is loaded only when it is needed
    "cellwright.engine.pipelines.precompute.problem_preparation",
    "cellwright.engine.stages.planning.forward",
    "cellwright.kb.asp.rule_compiler",
    "cellwright.kb.asp.trial_grounding",
    "cellwright.kb.loader.domain_file",
    "cellwright.kb.loader.loading",
    "cellwright.kb.loader.problem_file",
    "cellwright.kb.loader.device_uses",
    "cellwright.kb.schema.device",
    "cellwright.kb.schema.domain",
    "cellwright.kb.schema.problem",
    "cellwright.kb.store.unit_ledger",
)


def prepare_target(
    target: Annotated[
        str, Argument(help="a domain (all its problems), a folder of problems, or one problem")
    ],
    store: Library,
    jobs: Jobs = 0,
    cluster: Cluster = "",
    time_limit: TimeLimit = None,
    expansions: Expansions = None,
    seed: Seed = 0,
    format: Format = AnswerForm.TEXT,
) -> None:
    """Plan every problem of TARGET, sequence its measurements, and fill the store before plans
    are needed.
    """
    refuse_both(jobs, cluster)
    give_answer(
        lambda: _prepare_problems(
            target, store, crew_asked(jobs, cluster, UNITS), time_limit, expansions, seed
        ),
        format,
    )


def _prepare_problems(
    target: str,
    store: str,
    crew: "WorkCrew",
    seconds: float | None,
    expansions: int | None,
    seed: int,
) -> VerbAnswer:
    from cellwright.engine.pipelines.precompute import prepare_problems as prepare_all
    from cellwright.engine.pipelines.precompute.preparation_results import problems_of
    from cellwright.engine.stages.planning import SearchLimits, expansions_within

    paths = problems_of(target)
    with SearchInterruption(seconds) as interrupted, progress_of("planning") as progress:
        limits = SearchLimits(
            expansions_within(expansions, seconds), interrupted=interrupted, seed=seed
        )
        preparation = prepare_all(paths, store, limits, crew, progress)
    statuses = {problem.status for problem in preparation.problems}
    code = INTERRUPTED if interrupted.heard else BAD_INPUT if "bad input" in statuses else 0
    if not code and "gave up" in statuses:
        code = LIMIT if interrupted() else GAVE_UP
    diagnostics = tuple(
        dict.fromkeys(d for problem in preparation.problems for d in problem.diagnostics)
    )
    if code == LIMIT:
        message = "the time was over before all problems were planned"
        over = Diagnostic(Source("--time-limit"), "K420", message, "give more seconds")
        diagnostics = (*diagnostics, over)
    return VerbAnswer(
        "ok" if not code else "incomplete",
        report.preparation_content(preparation),
        lambda: report.preparation_text(preparation),
        code,
        diagnostics,
    )
