"""`cellwright resume`: go on with a run after a stop, a crash or a power failure."""

from typing import Annotated

import typer

from engine.faces.cli import completion
from engine.faces.cli.answers import Answer, Form, give
from engine.faces.cli.options import Expansions, Format, Seed
from engine.faces.cli.run import Events, Store


def resume(
    run: Annotated[
        str,
        typer.Argument(
            metavar="RUN",
            help="the name of the run, as `cellwright run` printed it",
            autocompletion=completion.runs,
        ),
    ],
    store: Store = "",
    events: Events = "",
    expansions: Expansions = 1_000_000,
    seed: Seed = 0,
    format: Format = Form.TEXT,
) -> None:
    """Go on with RUN from its journal: ask the driver what became of commands under way, repeat none, and finish."""
    if events == "-" and format is Form.JSON:
        raise typer.BadParameter("--events - writes lines of JSON to the output: leave out --format json")

    def make() -> Answer:
        from engine.faces.cli.run import answer_of
        from engine.faces.cli.supervision import Watching
        from engine.pipelines.execution import resume as go_on
        from engine.stages.planning import Limits
        from kb.store.own import default_store

        where = store or default_store()
        with Watching(run, where, events, approve=False) as watch:
            ending = go_on(where, run, watch.channel, watch.watchers, Limits(expansions, seed=seed))
        return answer_of(ending, where, events == "-")

    give(make, format)
