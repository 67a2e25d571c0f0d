"""`cellwright stop`, `interrupt`, `continue` and their kin: tell a run that goes on in another process what to do."""

from typing import Annotated

from cellwright.engine.faces.cli import completion
from cellwright.engine.faces.cli.answers import Answer, Form, give
from cellwright.engine.faces.cli.declared import Argument, Option
from cellwright.engine.faces.cli.options import Format

RunName = Annotated[
    str,
    Argument(
        metavar="RUN",
        help="the name of the run, as `cellwright run` prints it",
        autocompletion=completion.runs,
    ),
]
Step = Annotated[str, Argument(metavar="STEP", help="a step of the plan: its number, or as it is written")]
Facts = Annotated[
    str, Argument(metavar="FACTS", help="facts, separated by ;, with a - before those that do not hold")
]
Said = Annotated[
    str,
    Argument(
        metavar="[ANSWER]", help="an outcome that the question allows, or a step; else the only open one"
    ),
]
Where = Annotated[str, Option("--store", help="the journal of RUN, if runs in several have its name")]
Words = Annotated[
    str,
    Argument(
        metavar="COMMAND",
        help="a further command, in the words of the domain; due(OBJECT, TIME) and priority(OBJECT, NUMBER) behind a ;",
    ),
]


def stop(run: RunName, store: Where = "", format: Format = Form.TEXT) -> None:
    """Stop RUN at once: nothing moves any more. It can be resumed."""
    _tell(run, "stop", "", "stops", store, format)


def interrupt(run: RunName, store: Where = "", format: Format = Form.TEXT) -> None:
    """Have RUN pause at the end of its current goal, with empty hands."""
    _tell(run, "interrupt", "", "pauses at the end of the current goal", store, format)


def go_on(run: RunName, store: Where = "", format: Format = Form.TEXT) -> None:
    """Have RUN go on after a pause."""
    _tell(run, "continue", "", "goes on", store, format)


def approve(run: RunName, store: Where = "", format: Format = Form.TEXT) -> None:
    """Approve the plan that RUN waits with."""
    _tell(run, "approve", "", "is approved", store, format)


def abort(run: RunName, store: Where = "", format: Format = Form.TEXT) -> None:
    """End RUN for good."""
    _tell(run, "abort", "", "is ended", store, format)


def skip(run: RunName, step: Step, store: Where = "", format: Format = Form.TEXT) -> None:
    """At a pause of RUN, take STEP for done: somebody has done it by hand."""
    _tell(run, "skip", step, f"takes {step} for done", store, format)


def retry(run: RunName, store: Where = "", format: Format = Form.TEXT) -> None:
    """At a pause of RUN, try what is left once more, from the world as it is."""
    _tell(run, "retry", "", "tries again", store, format)


def back(run: RunName, step: Step, store: Where = "", format: Format = Form.TEXT) -> None:
    """At a pause of RUN, go back to STEP and do it, and what comes behind it, again."""
    _tell(run, "back", step, f"goes back to {step}", store, format)


def correct(run: RunName, facts: Facts, store: Where = "", format: Format = Form.TEXT) -> None:
    """At a pause of RUN, correct what it holds for true, and have it plan on from there."""
    _tell(run, "correct", facts, "takes note", store, format)


def answer(run: RunName, text: Said = "", store: Where = "", format: Format = Form.TEXT) -> None:
    """Answer what RUN asks a person: one of the outcomes of a question, or a step that was done by hand."""
    _tell(run, "answer", text, "hears it", store, format)


def add(run: RunName, command: Words, store: Where = "", format: Format = Form.TEXT) -> None:
    """Give RUN a further command, a due date or a priority; it joins what is pursued."""
    _tell(run, "add", command, "takes the command up", store, format)


def _tell(run: str, order: str, text: str, said: str, store: str, form: Form) -> None:
    def make() -> Answer:
        from rich.text import Text

        from cellwright.engine.pipelines.execution.channel import REFUSABLE, tell
        from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source

        state = tell(run, order, text, store)
        if why := state.get("refused"):
            raise InvalidInput([Diagnostic(Source(run), "K421", f"{order} is refused: {why}")])
        later = order in REFUSABLE and "refused" not in state
        told = f"{run} has it; what comes of it is in its journal" if later else f"{run} {said}"
        return Answer("ok", {"told": order, **state}, lambda: Text(f"{told}."))

    give(make, form)
