"""`cellwright resume`: go on with a run after a stop, a crash or a power failure."""

from typing import Annotated

from cellwright.engine.faces.cli import completion
from cellwright.engine.faces.cli.answers import Answer, Form, give
from cellwright.engine.faces.cli.declared import Argument, Option, misfit
from cellwright.engine.faces.cli.options import Expansions, Format, Seed, number
from cellwright.engine.faces.cli.run import Events, Store, Watch


def resume(
    run: Annotated[
        str,
        Argument(
            metavar="RUN",
            help="the name of the run, as `cellwright run` printed it",
            autocompletion=completion.runs,
        ),
    ],
    store: Store = "",
    factor: Annotated[
        float | None,
        Option(
            min=0,
            callback=number,
            help="the share of real time that simulated time takes; if not given, as before",
        ),
    ] = None,
    events: Events = "",
    watch: Watch = False,
    expansions: Expansions = 1_000_000,
    seed: Seed = 0,
    format: Format = Form.TEXT,
) -> None:
    """Go on with RUN from its journal: ask the driver what became of commands under way, repeat none, and finish."""
    if events == "-" and format is Form.JSON:
        raise misfit("--events - writes lines of JSON to the output: leave out --format json")
    give(lambda: _resumed(run, store, factor, events, watch, (expansions, seed)), format)


def _resumed(
    run: str, store: str, factor: float | None, events: str, watch: bool, search: tuple[int, int]
) -> Answer:
    from cellwright.engine.faces.cli.run import answer_of
    from cellwright.engine.faces.cli.supervision import Watching
    from cellwright.engine.pipelines.execution import resume as go_on
    from cellwright.engine.pipelines.execution.begin import followed
    from cellwright.engine.stages.planning import Limits
    from cellwright.kb.store.own import default_store

    where = store or default_store()
    pace, before = followed(where, run, factor) if watch else (0.0, ())
    with Watching(run, where, events, False, watch, pace, before) as seen:
        limits = Limits(search[0], seed=search[1])
        ending = go_on(where, run, seen.channel, seen.watchers, limits, factor)
    return answer_of(ending, where, events == "-")
