"""Decision trees, cases and their results, as text and as data."""

from collections.abc import Mapping, Sequence
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text
from rich.tree import Tree as RichTree

from cellwright.engine.formats.report.rows import TextTable
from cellwright.engine.model.cases import CaseStep, Diagnosis, Revision
from cellwright.engine.model.troubleshooting import Advice, Conclude, Tree, Troubleshooting
from cellwright.engine.model.wording import worded
from cellwright.kb.model.faults import FaultModel
from cellwright.kb.terms import Atom, Variable

SMALL = 0.001  # texts leave out smaller probabilities


def number(value: float) -> str:
    """A cost with at most two decimals."""
    return f"{value:.2f}".rstrip("0").rstrip(".")


def concluded(problem: Troubleshooting, leaf: Conclude) -> str:
    """The text of a leaf."""
    return "cured" if leaf.conclusion is None else problem.conclusions[leaf.conclusion].name


def tree(problem: Troubleshooting, root: Tree, cost: float, bound: float) -> RenderableType:
    """The whole tree with probabilities and costs."""
    proof = "optimal" if bound >= cost - 1e-6 else f"at least {number(bound)} for any tree"
    drawn = RichTree(Text(f"expected cost {number(cost)} ({proof})"))
    _grow(drawn, problem, root)
    return drawn


def _grow(parent: RichTree, problem: Troubleshooting, part: Tree, outcome: str = "") -> None:
    before = f"{outcome}: " if outcome else ""
    share = f"{100 * part.probability:.1f} %"
    if isinstance(part, Conclude):
        parent.add(Text(f"{before}{concluded(problem, part)}  {share}"))
        return
    action = problem.actions[part.action]
    branch = parent.add(Text(f"{before}{action.name}  {share}, cost {number(part.cost)}"))
    for index, following in part.branches:
        _grow(branch, problem, following, action.outcomes[index])


def tree_entry(problem: Troubleshooting, part: Tree) -> dict[str, Any]:
    """The tree for programs."""
    if isinstance(part, Conclude):
        return {"probability": round(part.probability, 9), "conclusion": concluded(problem, part)}
    action = problem.actions[part.action]
    return {
        "probability": round(part.probability, 9),
        "action": action.name,
        "cost": round(part.cost, 6),
        "outcomes": {action.outcomes[index]: tree_entry(problem, each) for index, each in part.branches},
    }


def advice_entry(problem: Troubleshooting, advice: Advice) -> dict[str, Any]:
    """What to do next, for programs."""
    chosen = None if advice.action is None else problem.actions[advice.action].name
    return {
        "action": chosen,
        "expected cost": round(advice.expected_cost, 6),
        "bound": round(advice.bound, 6),
        "optimal": bool(advice.optimal),
        "expansions": advice.expansions,
    }


def reasons(
    problem: Troubleshooting, advice: Advice, compared: Sequence[tuple[int, float, bool]]
) -> TextTable:
    """The reason for the next action: the expected cost of beginning with each other action."""
    rows = []
    for action, cost, exact in sorted(compared, key=lambda row: (row[1], row[0])):
        sign = "" if exact else "at least "
        more = cost - advice.expected_cost
        said = "chosen" if action == advice.action else number(max(0.0, more))
        rows.append((problem.actions[action].name, sign + number(cost), said))
    return TextTable(("begin with", "expected cost", "more than the best"), rows)


def belief(pairs: Sequence[tuple[str, float]], most: int = 8) -> TextTable:
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


def case(
    model: FaultModel, made: Diagnosis, certain: Mapping[Atom, float], change: Revision
) -> RenderableType:
    """How a case went and how it ended."""
    rows = [
        (str(place), stage.observed.action, stage.observed.outcome, number(stage.cost))
        for place, stage in enumerate(made.stages, 1)
    ]
    steps = TextTable(("", "test or repair", "outcome", "cost"), rows)
    prepared = [line for place, stage in enumerate(made.stages, 1) for line in _prepared(place, stage)]
    parts: list[RenderableType] = [Text(worded(made.exception, model.exceptions[made.exception].say))]
    parts += [steps] if made.stages else []
    parts += [Text(line) for line in prepared]
    parts += [Text(line) for line in (*_ending(model, made), *_changes(certain, change))]
    return Group(*parts)


def _prepared(place: int, stage: CaseStep) -> list[str]:
    """The steps that were taken before a test or repair."""
    if not stage.steps:
        return []
    steps = "; ".join(str(step.operator) for step in stage.steps)
    return [f"before {place}, {stage.observed.action}: {steps}"]


def _ending(model: FaultModel, made: Diagnosis) -> list[str]:
    lines = []
    if made.cured:
        says = model.repairs[made.cured].say if made.cured in model.repairs else ""
        lines.append(f"cured by {worded(made.cured, says)}")
    if made.isolated:
        says = _says(model, made)
        lines.append(f"cause: {made.hypotheses[0][0]}" + (f" ({says})" if says else ""))
    else:
        lines += [
            f"possible: {hypothesis} {chance:.3f}"
            for hypothesis, chance in made.hypotheses
            if chance >= SMALL
        ]
    if made.repairs and not made.cured:
        lines.append(f"repair: {worded(made.repairs[0], model.repairs[made.repairs[0]].say)}")
    if not (made.cured or made.repairs or made.question):
        lines.append("stopped safely: the fault was not repaired")
    if made.question:
        lines.append(f"stop safely and ask: {made.question.text} ({', '.join(made.question.answers)})")
    return [*lines, f"cost {number(made.cost)}; tests and repairs took {_duration(model, made)}"]


def _duration(model: FaultModel, made: Diagnosis) -> int:
    return sum(model.duration(each.action) for each in made.observations)


def _says(model: FaultModel, made: Diagnosis) -> str:
    """What the causes are, for people; empty if the fault base says it of none of them."""
    causes = made.hypotheses[0][0].causes
    said = any(model.causes[cause].say for cause in causes)
    return "; ".join(model.causes[cause].say or cause for cause in causes) if said else ""


def _changes(certain: Mapping[Atom, float], change: Revision) -> list[str]:
    lines = [f"uncertain: {atom} {value:.3f}" for atom, value in certain.items() if 0.0 < value < 1 - SMALL]
    lines += [f"withdrawn: {atom} ({why})" for atom, why in change.withdrawn]
    lines += [f"asserted: {atom} ({why})" for atom, why in change.asserted]
    lines += [f"restored: {atom} ({why})" for atom, why in change.restored]
    lines += [f"assumed: {atom} ({why})" for atom, why in change.assumed]
    lines += [f"follows: {atom}" if holds else f"follows: not {atom}" for atom, holds in change.follows]
    lines += [f"kept: {atom} ({why})" for atom, why in change.kept]
    lines += [f"lost: {_thing(name)}" for name in change.lost]
    return lines + _blocked(change)


def _thing(name: str) -> str:
    """A thing that is lost, or which argument of the failed step it is if nobody has told the step."""
    return f"the {name} of the step that failed (say which step with --step)" if name[:1].isupper() else name


def _blocked(change: Revision) -> list[str]:
    """The steps that are not tried, those with one reason together."""
    steps: dict[str, list[str]] = {}
    for step, why in change.blocked:
        every = all(isinstance(each, Variable) for each in step.arguments)
        steps.setdefault(why, []).append(step.name if every else str(step))
    return [f"not tried again: {', '.join(names)} ({why})" for why, names in steps.items()]


def case_entry(made: Diagnosis, certain: Mapping[Atom, float], change: Revision) -> dict[str, Any]:
    """How a case went and how it ended, for programs."""
    found: dict[str, Any] = {
        "exception": made.exception,
        "observations": [
            {
                "action": s.observed.action,
                "outcome": s.observed.outcome,
                "cost": round(s.cost, 6),
                "steps": [str(step.operator) for step in s.steps],
            }
            for s in made.stages
        ],
        "hypotheses": [
            {"causes": list(h.causes), "wrong observations": list(h.lies), "probability": round(p, 9)}
            for h, p in made.hypotheses
        ],
        "isolated": made.isolated,
        "finished": made.finished,
        "cured": made.cured,
        "repairs": list(made.repairs),
        "cost": round(made.cost, 6),
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
    if made.question:
        found["question"] = {"text": made.question.text, "answers": list(made.question.answers)}
    return found
