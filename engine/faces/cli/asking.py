"""A person at the terminal who carries out tests and repairs, and says what they showed."""

from typing import TYPE_CHECKING

from cellwright.kb.numbers import is_count

if TYPE_CHECKING:
    from collections.abc import Sequence

    from cellwright.engine.faces.cli.interruption import Interruption
    from cellwright.engine.model.troubleshooting import Action, Advice
    from cellwright.engine.pipelines.troubleshooting import Desk
    from cellwright.engine.stages.diagnosis.session import Answerer


def asking(found: "Desk", interrupted: "Interruption") -> "Answerer":
    """A function that asks the person at the terminal. An empty line, Ctrl-C or the end of the input ends the case."""
    from cellwright.engine.faces.cli import terminal
    from cellwright.engine.faces.cli.slow import hushed
    from cellwright.engine.formats.report import diagnosis as report

    console = terminal.console(stderr=True)

    def ask(action: "Action", advice: "Advice") -> str | None:
        with hushed():
            return asked(action, advice)

    def asked(action: "Action", advice: "Advice") -> str | None:
        session = found.session
        if advice.action is None:
            console.print(found.session.diagnosis().question_text, markup=False)
        else:
            console.print(report.belief([(str(h), p) for h, p in session.belief()]))
        prepared = session.prepared.steps if session.prepared and advice.action is not None else ()
        if prepared:
            steps = "; ".join(str(step.operator) for step in prepared)
            console.print(f"first: {steps}", markup=False, highlight=False)
        says = found.says(action.name)
        choices = ", ".join(f"{n} {outcome}" for n, outcome in enumerate(action.outcomes, 1))
        while True:
            console.print(f"{action.name}: {says}\n  {choices}: ", end="", markup=False, highlight=False)
            said = _line(interrupted)
            if not said:
                return None
            if (meant := _meant(said, action.outcomes)) is not None:
                return meant

    return ask


def _meant(said: str, outcomes: "Sequence[str]") -> str | None:
    """The outcome that is named by its text or its number; None if none is."""
    if said in outcomes:
        return said
    return outcomes[int(said) - 1] if is_count(said) and 1 <= int(said) <= len(outcomes) else None


def _line(interrupted: "Interruption") -> str:
    """What is typed in a line, without spaces around it; nothing at Ctrl-C and at the end of the input."""
    import sys

    try:
        with interrupted.while_waiting():
            return sys.stdin.readline().strip()
    except KeyboardInterrupt:
        return ""
