"""A plan in Graphviz's DOT language: orders are solid edges, causal links are dashed edges with their condition."""

from collections.abc import Callable, Iterator

from cellwright.engine.model.purposes import wording
from cellwright.kb.diagnostics import escaped
from cellwright.kb.model.plan import GOAL, START, Plan, StepId
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import Atom


def plan(made: Plan, problem: Problem | None = None) -> str:
    """The partial order with its causal links. Stages have the names of the problem."""
    lines = (f"  {line}" for line in _lines(made, wording(problem)))
    return "\n".join(["digraph plan {", *lines, "}"]) + "\n"


def _lines(made: Plan, say: Callable[[Atom], str]) -> Iterator[str]:
    yield 'node [shape=box, style=rounded, fontname="Helvetica"];'
    yield 'edge [fontname="Helvetica", fontsize=10];'
    yield "start [shape=circle];"
    yield "goal [shape=doublecircle];"
    for step in made.steps:
        held = f"\\n[{_escaped(', '.join(map(str, step.resources)))}]" if step.resources else ""
        yield f'{step.id} [label="{step.id} {_escaped(str(step.operator))}{held}"];'
    for earlier, later in orders(made):
        yield f"{_name(earlier)} -> {_name(later)};"
    for link in made.links:
        label = _escaped(say(link.condition))
        ends = f"{_name(link.producer)} -> {_name(link.consumer)}"
        yield f'{ends} [style=dashed, color=steelblue, fontcolor=steelblue, constraint=false, label="{label}"];'


def orders(made: Plan) -> Iterator[tuple[StepId, StepId]]:
    """The direct orders. The start comes before steps that wait for nothing, the goal after steps for which nothing waits."""
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
    """Text for a quoted string. A backslash is escaped, because Graphviz gives it a meaning."""
    return escaped(text).replace("\\", "\\\\").replace('"', '\\"')
