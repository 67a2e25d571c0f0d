"""A person at the terminal who carries out tests and repairs, and says what they showed."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from engine.model.troubleshooting import Action, Advice
    from engine.pipelines.troubleshooting import Desk
    from engine.stages.diagnosis.session import Answerer


def asking(found: "Desk") -> "Answerer":
    """A function that asks the person at the terminal. An empty line or the end of the input ends the case."""
    import sys

    from rich.console import Console

    from engine.formats.report import diagnosis as report

    console = Console(stderr=True)

    def ask(action: "Action", advice: "Advice") -> str | None:
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
            said = sys.stdin.readline()
            if not said.strip():
                return None
            if said.strip() in action.outcomes:
                return said.strip()
            if said.strip().isdigit() and 1 <= int(said) <= len(action.outcomes):
                return action.outcomes[int(said) - 1]

    return ask
