"""Decision trees, cases and their results, as text, as data and as SVG."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any
from xml.sax.saxutils import escape

from rich.console import Group, RenderableType
from rich.text import Text
from rich.tree import Tree as RichTree

from cellwright.engine.formats.report.text_tables import TextTable
from cellwright.engine.model.noun_wording import name_with_meaning
from cellwright.engine.model.troubleshooting import (
    CaseAdvice,
    CaseDiagnosis,
    CaseStep,
    Conclude,
    Revision,
    Tree,
    Troubleshooting,
)
from cellwright.kb.model.fault_model import FaultModel
from cellwright.kb.terms import Atom, Variable

MIN_SHOWN_PROBABILITY = 0.001  # texts leave out smaller probabilities


def cost_text(value: float) -> str:
    """A cost with at most two decimals."""
    return f"{value:.2f}".rstrip("0").rstrip(".")


def conclusion_text(problem: Troubleshooting, leaf: Conclude) -> str:
    """The text of a leaf."""
    return "cured" if leaf.conclusion is None else problem.conclusions[leaf.conclusion].name


def decision_tree_text(
    problem: Troubleshooting, root: Tree, cost: float, bound: float
) -> RenderableType:
    """The whole tree with probabilities and costs."""
    proof = "optimal" if bound >= cost - 1e-6 else f"at least {cost_text(bound)} for any tree"
    drawn = RichTree(Text(f"expected cost {cost_text(cost)} ({proof})"))
    _grow_tree(drawn, problem, root)
    return drawn


def _grow_tree(parent: RichTree, problem: Troubleshooting, part: Tree, outcome: str = "") -> None:
    before = f"{outcome}: " if outcome else ""
    share = f"{100 * part.probability:.1f} %"
    if isinstance(part, Conclude):
        parent.add(Text(f"{before}{conclusion_text(problem, part)}  {share}"))
        return
    action = problem.actions[part.action]
    branch = parent.add(Text(f"{before}{action.name}  {share}, cost {cost_text(part.cost)}"))
    for index, following in part.branches:
        _grow_tree(branch, problem, following, action.outcomes[index])


def tree_entry(problem: Troubleshooting, part: Tree) -> dict[str, Any]:
    """The tree for programs."""
    if isinstance(part, Conclude):
        return {
            "probability": round(part.probability, 9),
            "conclusion": conclusion_text(problem, part),
        }
    action = problem.actions[part.action]
    return {
        "probability": round(part.probability, 9),
        "action": action.name,
        "cost": round(part.cost, 6),
        "outcomes": {
            action.outcomes[index]: tree_entry(problem, subtree) for index, subtree in part.branches
        },
    }


def advice_entry(problem: Troubleshooting, advice: CaseAdvice) -> dict[str, Any]:
    """What to do next, for programs."""
    chosen = None if advice.action is None else problem.actions[advice.action].name
    return {
        "action": chosen,
        "expected cost": round(advice.expected_cost, 6),
        "bound": round(advice.bound, 6),
        "optimal": bool(advice.optimal),
        "expansions": advice.expansions,
    }


def advice_reasons(
    problem: Troubleshooting, advice: CaseAdvice, compared: Sequence[tuple[int, float, bool]]
) -> TextTable:
    """The reason for the next action: the expected cost of beginning with each other action."""
    rows = []
    for action, cost, exact in sorted(compared, key=lambda row: (row[1], row[0])):
        sign = "" if exact else "at least "
        more = cost - advice.expected_cost
        extra_cost = "chosen" if action == advice.action else cost_text(max(0.0, more))
        rows.append((problem.actions[action].name, sign + cost_text(cost), extra_cost))
    return TextTable(("begin with", "expected cost", "more than the best"), rows)


def belief_table(pairs: Sequence[tuple[str, float]], most: int = 8) -> TextTable:
    """The causes that are still possible, the most probable first."""
    rows = [(name, f"{probability:.3f}") for name, probability in pairs[:most]]
    if len(pairs) > most:
        rows.append(
            (
                f"and {len(pairs) - most} more (--format json has all)",
                f"{sum(p for _, p in pairs[most:]):.3f}",
            )
        )
    return TextTable(("cause", "probability"), rows)


def case_text(
    model: FaultModel,
    case_diagnosis: CaseDiagnosis,
    certain: Mapping[Atom, float],
    change: Revision,
) -> RenderableType:
    """How a case went and how it ended."""
    rows = [
        (str(place), stage.observed.action, stage.observed.outcome, cost_text(stage.cost))
        for place, stage in enumerate(case_diagnosis.stages, 1)
    ]
    steps = TextTable(("", "test or repair", "outcome", "cost"), rows)
    prepared = [
        line
        for place, stage in enumerate(case_diagnosis.stages, 1)
        for line in _preparation_lines(place, stage)
    ]
    parts: list[RenderableType] = [
        Text(
            name_with_meaning(
                case_diagnosis.exception, model.exceptions[case_diagnosis.exception].say
            )
        )
    ]
    parts += [steps] if case_diagnosis.stages else []
    parts += [Text(line) for line in prepared]
    parts += [
        Text(line)
        for line in (*_ending_lines(model, case_diagnosis), *_change_lines(certain, change))
    ]
    return Group(*parts)


def _preparation_lines(place: int, stage: CaseStep) -> list[str]:
    """The steps that were taken before a test or repair."""
    if not stage.steps:
        return []
    steps = "; ".join(str(step.operator) for step in stage.steps)
    return [f"before {place}, {stage.observed.action}: {steps}"]


def _ending_lines(model: FaultModel, case_diagnosis: CaseDiagnosis) -> list[str]:
    lines = []
    if case_diagnosis.cured:
        says = (
            model.repairs[case_diagnosis.cured].say if case_diagnosis.cured in model.repairs else ""
        )
        lines.append(f"cured by {name_with_meaning(case_diagnosis.cured, says)}")
    if case_diagnosis.isolated:
        says = _cause_text(model, case_diagnosis)
        lines.append(f"cause: {case_diagnosis.hypotheses[0][0]}" + (f" ({says})" if says else ""))
    if not case_diagnosis.isolated or len(case_diagnosis.hypotheses) > 1:
        lines += [
            f"possible: {hypothesis} {chance:.3f}"
            for hypothesis, chance in case_diagnosis.hypotheses
            if chance >= MIN_SHOWN_PROBABILITY
        ]
    if case_diagnosis.repairs and not case_diagnosis.cured:
        lines.append(
            "repair: "
            f"{name_with_meaning(case_diagnosis.repairs[0], model.repairs[case_diagnosis.repairs[0]].say)}"
        )
    if not (case_diagnosis.cured or case_diagnosis.repairs or case_diagnosis.question):
        lines.append("stopped safely: the fault was not repaired")
    if case_diagnosis.question:
        lines.append(
            f"stop safely and ask: {case_diagnosis.question.text} "
            f"({', '.join(case_diagnosis.question.answers)})"
        )
    return [
        *lines,
        f"cost {cost_text(case_diagnosis.cost)}; tests and repairs took "
        f"{_case_duration(model, case_diagnosis)}",
    ]


def _case_duration(model: FaultModel, case_diagnosis: CaseDiagnosis) -> int:
    return sum(model.duration(observation.action) for observation in case_diagnosis.observations)


def _cause_text(model: FaultModel, case_diagnosis: CaseDiagnosis) -> str:
    """What the causes are, for people; empty if the fault base says it of none of them."""
    causes = case_diagnosis.hypotheses[0][0].causes
    has_text = any(model.causes[cause].say for cause in causes)
    return "; ".join(model.causes[cause].say or cause for cause in causes) if has_text else ""


def _change_lines(certain: Mapping[Atom, float], change: Revision) -> list[str]:
    lines = [
        f"uncertain: {atom} {value:.3f}"
        for atom, value in certain.items()
        if 0.0 < value < 1 - MIN_SHOWN_PROBABILITY
    ]
    lines += [f"withdrawn: {atom} ({why})" for atom, why in change.withdrawn]
    lines += [f"asserted: {atom} ({why})" for atom, why in change.asserted]
    lines += [f"restored: {atom} ({why})" for atom, why in change.restored]
    lines += [f"assumed: {atom} ({why})" for atom, why in change.assumed]
    lines += [
        f"follows: {atom}" if holds else f"follows: not {atom}" for atom, holds in change.follows
    ]
    lines += [f"kept: {atom} ({why})" for atom, why in change.kept]
    lines += [f"lost: {_lost_object_text(name)}" for name in change.lost]
    return lines + _blocked_steps(change)


def _lost_object_text(name: str) -> str:
    """A thing that is lost, or which argument of the failed step it is if nobody has told the
    step.
    """
    return (
        f"the {name} of the step that failed (say which step with --step)"
        if name[:1].isupper()
        else name
    )


def _blocked_steps(change: Revision) -> list[str]:
    """The steps that are not tried, those with one reason together."""
    steps: dict[str, list[str]] = {}
    for step, why in change.blocked:
        every = all(isinstance(argument, Variable) for argument in step.arguments)
        steps.setdefault(why, []).append(step.name if every else str(step))
    return [f"not tried again: {', '.join(names)} ({why})" for why, names in steps.items()]


def case_entry(
    case_diagnosis: CaseDiagnosis, certain: Mapping[Atom, float], change: Revision
) -> dict[str, Any]:
    """How a case went and how it ended, for programs."""
    case_data: dict[str, Any] = {
        "exception": case_diagnosis.exception,
        "observations": [
            {
                "action": s.observed.action,
                "outcome": s.observed.outcome,
                "cost": round(s.cost, 6),
                "steps": [str(step.operator) for step in s.steps],
            }
            for s in case_diagnosis.stages
        ],
        "hypotheses": [
            {
                "causes": list(h.causes),
                "wrong observations": list(h.lies),
                "probability": round(p, 9),
            }
            for h, p in case_diagnosis.hypotheses
        ],
        "isolated": case_diagnosis.isolated,
        "finished": case_diagnosis.finished,
        "cured": case_diagnosis.cured,
        "repairs": list(case_diagnosis.repairs),
        "cost": round(case_diagnosis.cost, 6),
        "certainty": {str(atom): round(value, 9) for atom, value in certain.items()},
        "withdrawn": {str(atom): why for atom, why in change.withdrawn},
        "asserted": {str(atom): why for atom, why in change.asserted},
        "restored": {str(atom): why for atom, why in change.restored},
        "assumed": {str(atom): why for atom, why in change.assumed},
        "follows": {str(atom): holds for atom, holds in change.follows},
        "kept": {str(atom): why for atom, why in change.kept},
        "lost": list(change.lost),
        "blocked": {str(step): why for step, why in change.blocked},
    }
    if case_diagnosis.question:
        case_data["question"] = {
            "text": case_diagnosis.question.text,
            "answers": list(case_diagnosis.question.answers),
        }
    return case_data


CHARACTER, HEIGHT, GAP, MARGIN, BETWEEN = 7.3, 38, 12, 20, 150
INK, PAPER, BOX, LEAF = "#1b1b1b", "#ffffff", "#e3ecf6", "#e6f3ea"


@dataclass(frozen=True, slots=True)
class _PlacedNode:
    """A part of the tree with its position: `x`, `y` is the middle of its left edge."""

    lines: tuple[str, str]
    leaf: bool
    x: float
    y: float
    children: tuple[tuple[str, "_PlacedNode"], ...]


def decision_tree_svg(problem: Troubleshooting, root: Tree, cost: float) -> str:
    """The picture. The same tree gives the same bytes."""
    width = CHARACTER * max(len(line) for line in _node_texts(problem, root)) + 16
    placed, below = _place_node(problem, root, MARGIN, MARGIN + 28.0, width)
    right = max(part.x for part in _all_nodes(placed)) + width + MARGIN
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{right:.0f}" '
        f'height="{below + MARGIN:.0f}" '
        f'viewBox="0 0 {right:.0f} {below + MARGIN:.0f}" font-family="sans-serif" font-size="12">'
    )
    title = (
        f'<text x="{MARGIN}" y="{MARGIN + 4}" fill="{INK}">expected cost {cost_text(cost)}</text>'
    )
    paper = f'<rect width="100%" height="100%" fill="{PAPER}"/>'
    return (
        "\n".join(
            [head, paper, title, *_tree_lines(placed, width), *_tree_boxes(placed, width), "</svg>"]
        )
        + "\n"
    )


def _node_texts(problem: Troubleshooting, part: Tree) -> Iterator[str]:
    yield from _node_title(problem, part)
    if not isinstance(part, Conclude):
        for _, following in part.branches:
            yield from _node_texts(problem, following)


def _node_title(problem: Troubleshooting, part: Tree) -> tuple[str, str]:
    share = f"{100 * part.probability:.1f} %"
    if isinstance(part, Conclude):
        return conclusion_text(problem, part), share
    return problem.actions[part.action].name, f"{share}, cost {cost_text(part.cost)}"


def _place_node(
    problem: Troubleshooting, part: Tree, x: float, top: float, width: float
) -> tuple[_PlacedNode, float]:
    """The part with everything below it in the tree, placed from `top` downwards; and its lower
    end.
    """
    lines = _node_title(problem, part)
    if isinstance(part, Conclude):
        return _PlacedNode(lines, True, x, top + HEIGHT / 2, ()), top + HEIGHT + GAP
    children: list[tuple[str, _PlacedNode]] = []
    for outcome, following in part.branches:
        child, top = _place_node(problem, following, x + width + BETWEEN, top, width)
        children.append((problem.actions[part.action].outcomes[outcome], child))
    middle = (children[0][1].y + children[-1][1].y) / 2
    return _PlacedNode(lines, False, x, middle, tuple(children)), top


def _all_nodes(part: _PlacedNode) -> Iterator[_PlacedNode]:
    yield part
    for _, child in part.children:
        yield from _all_nodes(child)


def _tree_lines(root: _PlacedNode, width: float) -> Iterator[str]:
    for part in _all_nodes(root):
        for outcome, child in part.children:
            start, bend = part.x + width, part.x + width + 24
            path_data = (
                f"M {start:.1f} {part.y:.1f} C {bend:.1f} {part.y:.1f} {start:.1f} "
                f"{child.y:.1f} {bend:.1f} {child.y:.1f}"
            )
            yield f'<path d="{path_data} H {child.x:.1f}" fill="none" stroke="{INK}"/>'
            yield (
                f'<text x="{child.x - 6:.1f}" y="{child.y - 5:.1f}" text-anchor="end" fill="{INK}">'
                f"{escape(outcome)}</text>"
            )


def _tree_boxes(root: _PlacedNode, width: float) -> Iterator[str]:
    for part in _all_nodes(root):
        top, round_ = part.y - HEIGHT / 2, 16 if part.leaf else 3
        fill = LEAF if part.leaf else BOX
        yield (
            f'<rect x="{part.x:.1f}" y="{top:.1f}" width="{width:.1f}" height="{HEIGHT}" '
            f'rx="{round_}" '
            f'fill="{fill}" stroke="{INK}"/>'
        )
        for place, line in enumerate(part.lines):
            y = top + 15 + 15 * place
            yield f'<text x="{part.x + 8:.1f}" y="{y:.1f}" fill="{INK}">{escape(line)}</text>'
