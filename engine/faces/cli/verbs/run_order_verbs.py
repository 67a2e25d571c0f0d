"""The verbs that command a run in another process: `stop`, `interrupt`, `continue` and others."""

from typing import Annotated

from typer import Argument, Option

from cellwright.engine.faces.cli.options import shared_options
from cellwright.engine.faces.cli.options.shared_options import Format
from cellwright.engine.faces.cli.output.answer_output import AnswerForm, VerbAnswer, give_answer
from cellwright.engine.formats.report import rich_parts
from cellwright.engine.pipelines import execution
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source

RunName = Annotated[
    str,
    Argument(
        metavar="RUN",
        help="the name of the run, as `cellwright run` prints it",
        autocompletion=shared_options.complete_runs,
    ),
]
Step = Annotated[
    str, Argument(metavar="STEP", help="a step of the plan: its number, or as it is written")
]
Facts = Annotated[
    str,
    Argument(metavar="FACTS", help="facts, separated by ;, with a - before those that do not hold"),
]
Said = Annotated[
    str,
    Argument(
        metavar="[ANSWER]",
        help="an outcome that the question allows, or a step; else the only open one",
    ),
]
Where = Annotated[
    str, Option("--store", help="the journal of RUN, if runs in several have its name")
]
Words = Annotated[
    str,
    Argument(
        metavar="COMMAND",
        help="a further command, in the words of the domain; due(OBJECT, TIME) and "
        "priority(OBJECT, NUMBER) behind a ;",
    ),
]


def stop_run(run: RunName, store: Where = "", format: Format = AnswerForm.TEXT) -> None:
    """Stop RUN at once: nothing moves any more. It can be resumed."""
    _tell_run(run, "stop", "", "stops", store, format)


def interrupt_run(run: RunName, store: Where = "", format: Format = AnswerForm.TEXT) -> None:
    """Have RUN pause at the end of its current goal, with empty hands."""
    _tell_run(run, "interrupt", "", "pauses at the end of the current goal", store, format)


def go_on(run: RunName, store: Where = "", format: Format = AnswerForm.TEXT) -> None:
    """Have RUN go on after a pause."""
    _tell_run(run, "continue", "", "goes on", store, format)


def approve_run_plan(run: RunName, store: Where = "", format: Format = AnswerForm.TEXT) -> None:
    """Approve the plan that RUN waits with."""
    _tell_run(run, "approve", "", "is approved", store, format)


def abort_run(run: RunName, store: Where = "", format: Format = AnswerForm.TEXT) -> None:
    """End RUN for good."""
    _tell_run(run, "abort", "", "is ended", store, format)


def skip_step(
    run: RunName, step: Step, store: Where = "", format: Format = AnswerForm.TEXT
) -> None:
    """At a pause of RUN, take STEP for done: somebody has done it by hand."""
    _tell_run(run, "skip", step, f"takes {step} for done", store, format)


def retry_rest(run: RunName, store: Where = "", format: Format = AnswerForm.TEXT) -> None:
    """At a pause of RUN, try what is left once more, from the world as it is."""
    _tell_run(run, "retry", "", "tries again", store, format)


def go_back_to_step(
    run: RunName, step: Step, store: Where = "", format: Format = AnswerForm.TEXT
) -> None:
    """At a pause of RUN, go back to STEP and do it, and what comes behind it, again."""
    _tell_run(run, "back", step, f"goes back to {step}", store, format)


def correct_world(
    run: RunName, facts: Facts, store: Where = "", format: Format = AnswerForm.TEXT
) -> None:
    """At a pause of RUN, correct what it holds for true, and have it plan on from there."""
    _tell_run(run, "correct", facts, "takes note", store, format)


def answer_question(
    run: RunName, text: Said = "", store: Where = "", format: Format = AnswerForm.TEXT
) -> None:
    """Answer what RUN asks a person: one of the outcomes of a question, or a step that was done
    by hand.
    """
    _tell_run(run, "answer", text, "hears it", store, format)


def add_run_command(
    run: RunName, command: Words, store: Where = "", format: Format = AnswerForm.TEXT
) -> None:
    """Give RUN a further command, a due date or a priority; it joins what is pursued."""
    _tell_run(run, "add", command, "takes the command up", store, format)


def _tell_run(run: str, order: str, text: str, said: str, store: str, form: AnswerForm) -> None:
    def make() -> VerbAnswer:
        state = execution.tell_run(run, order, text, store)
        if why := state.get("refused"):
            raise InvalidInput([Diagnostic(Source(run), "K421", f"{order} is refused: {why}")])
        later = order in execution.REFUSABLE_ORDERS and "refused" not in state
        reply_text = (
            f"{run} has it; what comes of it is in its journal" if later else f"{run} {said}"
        )
        return VerbAnswer("ok", {"told": order, **state}, lambda: rich_parts.Text(f"{reply_text}."))

    give_answer(make, form)
