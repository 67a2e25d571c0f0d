"""A plan in Graphviz's DOT language: orders as solid edges, causal links as dashed ones with their condition."""

from collections.abc import Iterator

from engine.model.schedule import plainly
from kb.model.plan import GOAL, START, Plan, StepId


def plan(made: Plan) -> str:
    """The partial order with its causal links."""
    return "\n".join(["digraph plan {", *(f"  {line}" for line in _lines(made)), "}"]) + "\n"


def _lines(made: Plan) -> Iterator[str]:
    yield 'node [shape=box, style=rounded, fontname="Helvetica"];'
    yield 'edge [fontname="Helvetica", fontsize=10];'
    yield "start [shape=circle];"
    yield "goal [shape=doublecircle];"
    for step in made.steps:
        held = f"\\n[{', '.join(map(str, step.resources))}]" if step.resources else ""
        yield f'{step.id} [label="{step.id} {_escaped(str(step.operator))}{_escaped(held)}"];'
    for earlier, later in orders(made):
        yield f"{_name(earlier)} -> {_name(later)};"
    for link in made.links:
        label = _escaped(plainly(link.condition))
        ends = f"{_name(link.producer)} -> {_name(link.consumer)}"
        yield f'{ends} [style=dashed, color=steelblue, fontcolor=steelblue, constraint=false, label="{label}"];'


def orders(made: Plan) -> Iterator[tuple[StepId, StepId]]:
    """The direct orders, with the start before all that waits for nothing and the goal after all that nothing waits for."""
    awaited = {before for step in made.steps for before in step.after}
    for step in made.steps:
        yield from ((before, step.id) for before in step.after or (START,))
        if step.id not in awaited:
            yield step.id, GOAL
    if not made.steps:
        yield START, GOAL


def _name(step: StepId) -> str:
    return {START: "start", GOAL: "goal"}.get(step, str(step))


def _escaped(text: str) -> str:
    return text.replace('"', '\\"')
