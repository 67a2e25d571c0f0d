"""Plans and nets of contact states in Graphviz's DOT language."""

from collections.abc import Callable, Iterator, Sequence

from cellwright.engine.model.answer_wording import condition_wording
from cellwright.engine.model.task_space import ContactNet, Transfer
from cellwright.kb.diagnostics import escape_controls
from cellwright.kb.model.plan_model import GOAL_STEP, INITIAL_STEP, Plan, StepId
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Atom


def plan_dot(drawn_plan: Plan, problem: Problem | None = None) -> str:
    """The partial order with its causal links. Stages have the names of the problem."""
    lines = (f"  {line}" for line in _plan_dot_lines(drawn_plan, condition_wording(problem)))
    return "\n".join(["digraph plan {", *lines, "}"]) + "\n"


def _plan_dot_lines(drawn_plan: Plan, say: Callable[[Atom], str]) -> Iterator[str]:
    yield 'node [shape=box, style=rounded, fontname="Helvetica"];'
    yield 'edge [fontname="Helvetica", fontsize=10];'
    yield "start [shape=circle];"
    yield "goal [shape=doublecircle];"
    for step in drawn_plan.steps:
        resource_text = (
            f"\\n[{_escape_dot(', '.join(map(str, step.resources)))}]" if step.resources else ""
        )
        yield f'{step.id} [label="{step.id} {_escape_dot(str(step.operator))}{resource_text}"];'
    for earlier, later in direct_orders(drawn_plan):
        yield f"{_node_name(earlier)} -> {_node_name(later)};"
    for link in drawn_plan.links:
        label = _escape_dot(say(link.condition))
        ends = f"{_node_name(link.producer)} -> {_node_name(link.consumer)}"
        yield (
            f"{ends} [style=dashed, color=steelblue, fontcolor=steelblue, constraint=false, "
            f'label="{label}"];'
        )


def direct_orders(drawn_plan: Plan) -> Iterator[tuple[StepId, StepId]]:
    """The direct orders. The start comes before steps that wait for nothing, the goal after
    steps for which nothing waits.
    """
    awaited = {before for step in drawn_plan.steps for before in step.after}
    for step in drawn_plan.steps:
        yield from ((before, step.id) for before in step.after or (INITIAL_STEP,))
        if step.id not in awaited:
            yield step.id, GOAL_STEP
    if not drawn_plan.steps:
        yield INITIAL_STEP, GOAL_STEP


def _node_name(step: StepId) -> str:
    return {INITIAL_STEP: "start", GOAL_STEP: "goal"}.get(step, str(step))


def _escape_dot(text: str) -> str:
    """Text for a quoted string. A backslash is escaped, because Graphviz gives it a meaning."""
    return escape_controls(text).replace("\\", "\\\\").replace('"', '\\"')


def net_dot(contact_net: ContactNet) -> str:
    """The net. Places with tokens at the start have a thick rim; arcs say what they move."""
    return (
        "\n".join(["digraph states {", *(f"  {line}" for line in _net_dot_lines(contact_net)), "}"])
        + "\n"
    )


def _net_dot_lines(contact_net: ContactNet) -> Iterator[str]:
    yield 'graph [rankdir=LR, fontname="Helvetica"];'
    yield 'node [fontname="Helvetica", fontsize=11];'
    yield 'edge [fontname="Helvetica", fontsize=9];'
    for place in contact_net.places:
        look = ', style=filled, fillcolor="#dbe9f8"' if place.robot else ""
        rim = ", penwidth=2.5" if place.initial else ""
        yield (
            f"{place.name} [shape=ellipse, "
            f'label="{place.name}\\n{_escape_net_dot(place.say)}"{look}{rim}];'
        )
    for number, transition in enumerate(contact_net.transitions, 1):
        condition = "".join(
            f"\\n[{_escape_net_dot(str(restriction))}]" for restriction in transition.restrictions
        )
        yield (
            f"T{number} [shape=box, height=0.3, "
            f'label="{_escape_net_dot(transition.name)}{condition}"];'
        )
        for name in dict.fromkeys(transition.inputs):
            yield (
                f'{name} -> T{number} [label="{_moved_tokens(transition.transfers, source=name)}"];'
            )
        for name in dict.fromkeys(transition.outputs):
            yield (
                f'T{number} -> {name} [label="{_moved_tokens(transition.transfers, target=name)}"];'
            )


def _moved_tokens(transfers: Sequence[Transfer], source: str = "", target: str = "") -> str:
    """The tokens that an arc moves, by type."""
    counts: dict[str, tuple[int, int]] = {}
    for row in transfers:
        if row.source == source or row.target == target:
            least, most = counts.get(row.type, (0, 0))
            counts[row.type] = (least + row.least, most + row.most)
    return _escape_net_dot(", ".join(f"{name}:{_token_number(*n)}" for name, n in counts.items()))


def _token_number(least: int, most: int) -> str:
    return str(most) if least == most else f"{least}..{most}"


def _escape_net_dot(text: str) -> str:
    return escape_controls(text).replace("\\", "\\\\").replace('"', '\\"')
