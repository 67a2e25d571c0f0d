"""Outcomes as rich tables."""

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from engine.model.outcome import Found, GaveUp, Infeasible, Outcome, Statistics
from engine.model.schedule import History, earliest_starts, histories, makespan, purposes
from kb.model.plan import Plan
from kb.model.problem import Problem


def outcome(result: Outcome, problem: Problem) -> RenderableType:
    """What a person reads on the terminal."""
    match result:
        case Found(plan):
            return plan_table(plan, problem)
        case Infeasible(reason):
            return Text(f"No plan exists: {reason}.")
        case GaveUp(reason):
            return Text(f"Gave up: {reason}.")


def plan_table(plan: Plan, problem: Problem) -> RenderableType:
    """Steps, what they wait for, when they can start, and what for they are there; then the histories."""
    timed = any(step.duration for step in plan.steps)
    unit = problem.domain.time_unit
    table = Table(box=None, pad_edge=False)
    table.add_column("step", justify="right")
    table.add_column("operator", overflow="fold")
    table.add_column("after", overflow="fold")
    if timed:
        table.add_column(f"start ({unit})", justify="right")
        table.add_column("for", justify="right")
    table.add_column("achieves", overflow="fold", ratio=1)
    starts, reasons = earliest_starts(plan), purposes(problem, plan)
    for step in plan.steps:
        times = [str(starts[step.id]), str(step.duration)] if timed else []
        achieved = reasons.get(step.id, {})
        why = "; ".join(f"{condition} for {', '.join(users)}" for condition, users in achieved.items())
        table.add_row(str(step.id), str(step.operator), ", ".join(map(str, step.after)), *times, why)
    said = [f"{len(plan.steps)} steps, cost {plan.cost}"]
    if timed:
        said.append(f"{makespan(plan)} {unit} when every step starts as early as it may")
    made = histories(problem, plan)
    return Group(table, *([_history_table(made, unit)] if made else []), Text(", ".join(said)))


def _history_table(made: tuple[History, ...], unit: str) -> RenderableType:
    table = Table(box=None, pad_edge=False, title_justify="left")
    table.add_column("object", no_wrap=True)
    table.add_column(f"what is done to it (stage, from, for in {unit}, step)", overflow="fold")
    for history in made:
        name = ", ".join([str(history.subject or history.chain), *history.names.values()])
        done = [f"{each.stage} {each.start} {each.duration} #{each.step}" for each in history.happenings]
        table.add_row(name, "; ".join(done))
    return table


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
