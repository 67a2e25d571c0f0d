"""Outcomes as rich tables."""

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from engine.model.outcome import Found, GaveUp, Infeasible, Outcome, Statistics
from kb.model.plan import GOAL, Plan, StepId
from kb.model.problem import Problem


def outcome(result: Outcome, problem: Problem) -> RenderableType:
    """What a person reads on the terminal."""
    match result:
        case Found(plan):
            return plan_table(plan)
        case Infeasible(reason):
            return Text(f"No plan exists: {reason}.")
        case GaveUp(reason):
            return Text(f"Gave up: {reason}.")


def plan_table(plan: Plan) -> RenderableType:
    """Steps, what they wait for, and what for they are there."""
    table = Table(box=None, pad_edge=False)
    for title, justify in (("step", "right"), ("operator", "left"), ("after", "left"), ("so that", "left")):
        table.add_column(
            title, justify="right" if justify == "right" else "left", no_wrap=title == "operator"
        )
    purposes = _purposes(plan)
    for step in plan.steps:
        after = ", ".join(map(str, step.after))
        table.add_row(str(step.id), str(step.operator), after, purposes.get(step.id, ""))
    return Group(table, Text(f"{len(plan.steps)} steps, cost {plan.cost}"))


def _purposes(plan: Plan) -> dict[StepId, str]:
    found: dict[StepId, list[str]] = {}
    for link in plan.links:
        consumer = "goal" if link.consumer == GOAL else str(link.consumer)
        found.setdefault(link.producer, []).append(f"{link.condition} for {consumer}")
    return {step: "; ".join(reasons) for step, reasons in found.items()}


def statistics(figures: Statistics) -> RenderableType:
    """Counts and seconds."""
    table = Table(box=None, pad_edge=False, show_header=False)
    table.add_column(justify="left")
    table.add_column(justify="right")
    for name, count in figures.counts.items():
        table.add_row(name, str(count))
    for name, seconds in figures.seconds.items():
        table.add_row(f"{name} (s)", f"{seconds:.3f}")
    return table
