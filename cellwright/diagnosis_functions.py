"""Diagnosis: the cause of an exception by the cheapest tests, and the whole decision tree."""

import random
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from cellwright.engine.formats import report
from cellwright.engine.formats.report import rich_parts
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.library_base import Answer, Deadline, Name, Target, limit_seconds, name_of

if TYPE_CHECKING:
    from rich.console import RenderableType

    from cellwright.engine.model.troubleshooting import (
        Action,
        CaseAdvice,
        CaseDiagnosis,
        Tree,
        Troubleshooting,
    )
    from cellwright.engine.pipelines.recovery.diagnosis_case import DiagnosisCase
    from cellwright.engine.pipelines.recovery.replanning import RecoveryResult
    from cellwright.engine.stages.diagnosis.case_session import Answerer

Ask = Callable[[str, Sequence[str]], "str | None"]


@dataclass(frozen=True, repr=False)
class Diagnosed(Answer):
    """The end of a case: what was tested, what can still be the cause, and how the work goes
    on, if that was asked for.
    """

    diagnosis: "CaseDiagnosis"
    recovery: "RecoveryResult | None" = field(default=None, compare=False)
    desk: "DiagnosisCase | None" = field(default=None, compare=False, repr=False)

    @property
    def status(self) -> str:
        """cured, isolated or open."""
        return (
            "cured" if self.diagnosis.cured else "isolated" if self.diagnosis.isolated else "open"
        )

    def data(self) -> Mapping[str, Any]:
        """The tests, the belief, what is certain, and the recovery."""
        desk = self._open
        change = desk.revision_after(self.diagnosis, self.recovery)
        content = report.case_entry(self.diagnosis, desk.certainties(self.diagnosis), change)
        return content | (
            {"recovery": report.recovery_entry(self.recovery)} if self.recovery else {}
        )

    def _renderable(self) -> "RenderableType":
        desk, made = self._open, self.diagnosis
        case = report.case_text(
            desk.model, made, desk.certainties(made), desk.revision_after(made, self.recovery)
        )
        return rich_parts.Group(
            case, *([report.recovery_text(self.recovery)] if self.recovery else [])
        )

    @property
    def _open(self) -> "DiagnosisCase":
        if self.desk is None:
            raise ValueError("this diagnosis was made by hand: only its values are there")
        return self.desk


@dataclass(frozen=True, repr=False)
class DecisionTree(Answer):
    """Every test in its order, with what follows from each outcome."""

    problem: "Troubleshooting"
    tree: "Tree"
    expected_cost: float
    bound: float
    optimal: bool

    @property
    def status(self) -> str:
        """optimal or found."""
        return "optimal" if self.optimal else "found"

    def data(self) -> Mapping[str, Any]:
        """The tree, its expected cost and a bound on that of any tree."""
        tree = report.tree_entry(self.problem, self.tree)
        return {
            "expected cost": round(self.expected_cost, 6),
            "bound": round(self.bound, 6),
            "tree": tree,
        }

    def svg(self) -> str | None:
        """The tree as a picture."""
        return report.decision_tree_svg(self.problem, self.tree, self.expected_cost)

    def _renderable(self) -> "RenderableType":
        return report.decision_tree_text(self.problem, self.tree, self.expected_cost, self.bound)


def decision_tree(
    target: Target,
    exception: str,
    *,
    step: str = "",
    objective: Literal["isolate", "repair"] | None = None,
    store: Name = "",
    seconds: float | None = None,
    expansions: int | None = None,
) -> DecisionTree:
    """The whole decision tree for an exception: at the least expected cost that is found.

    Raises `InvalidInput`, `TimeoutError`.
    """
    from cellwright.engine.model.troubleshooting import expected_cost

    with limit_seconds(seconds) as over:
        desk = _open_case(target, exception, step, objective, store, expansions, over, None)
        advice = desk.session.advice()
        tree = desk.session.selector.tree(desk.session.standing)
    problem = desk.session.case.problem
    return DecisionTree(problem, tree, expected_cost(tree), advice.bound, advice.optimal)


def diagnose(
    target: Target,
    exception: str,
    *,
    ask: Ask | None = None,
    outcomes: str = "",
    hidden: str = "",
    step: str = "",
    plan: "str | PathLike[str] | None" = None,
    done: str = "",
    holds: str = "",
    gone: str = "",
    objective: Literal["isolate", "repair"] | None = None,
    certainty: float | None = None,
    recover: bool = False,
    store: Name = "",
    seconds: float | None = None,
    expansions: int | None = None,
    seed: int = 0,
) -> Diagnosed:
    """Find the cause of an exception. Outcomes of tests come from one of three: `ask`, `outcomes`
    or `hidden`.

    `ask` is called with the name of a test and its possible outcomes, and returns one of them, or
    None to end. `outcomes` lists them ("look_at_spot=dry, tool_self_test=passed"). `hidden` names
    the causes of a simulated fault. `plan` is the file of the plan that failed at `step`, `done`
    its steps that are done, `holds` and `gone` what is seen against the model. `certainty` is the
    probability with which a cause counts as found. With `recover` the work is planned on. A `store`
    keeps the closed case and learns. Raises `InvalidInput`, `TimeoutError`.
    """
    from cellwright.engine.pipelines.recovery.case_input import (
        FailedPlan,
        ObservedFacts,
        seen_before,
    )
    from cellwright.engine.stages.diagnosis.case_session import run_session

    failed = FailedPlan(Path(plan), step, done) if plan else None
    with limit_seconds(seconds) as over:
        desk = _open_case(
            target,
            exception,
            step,
            objective,
            store,
            expansions,
            over,
            (failed, ObservedFacts(holds, gone), certainty),
        )
        answer = _outcome_answerer(desk, ask, outcomes, hidden, seed)
        made = run_session(desk.session, answer, seen_before(answer))
        if store:
            desk.keep(made, fspath(store))
        went_on = desk.recover(made, fspath(store)) if recover else None
    return Diagnosed(made, went_on, desk)


def _open_case(
    target: Target,
    exception: str,
    step: str,
    objective: str | None,
    store: Name,
    expansions: int | None,
    over: Deadline,
    seen: Any,
) -> "DiagnosisCase":
    from cellwright.engine.pipelines.recovery.diagnosis_case import open_diagnosis_case

    more = dict(zip(("failed", "seen", "certainty"), seen, strict=True)) if seen else {}
    name = name_of(target)
    return open_diagnosis_case(
        name, exception, step, objective, fspath(store), expansions, over, **more
    )


def _outcome_answerer(
    desk: "DiagnosisCase", ask: Ask | None, outcomes: str, hidden: str, seed: int
) -> "Answerer":
    from cellwright.engine.pipelines.recovery.case_input import hidden_hypothesis, scripted_answerer
    from cellwright.engine.stages.diagnosis.hidden_cause import HiddenWorld

    if [bool(ask), bool(outcomes), bool(hidden)].count(True) != 1:
        hint = "give one of ask, outcomes and hidden; `decision_tree` needs none of them"
        raise InvalidInput(
            [Diagnostic(Source("diagnose"), "K409", "who says what tests show is not clear", hint)]
        )
    if outcomes:
        return scripted_answerer(desk.model, outcomes)
    if hidden:
        world = HiddenWorld(desk.model, hidden_hypothesis(desk.model, hidden), random.Random(seed))
        return lambda action, _: world.respond(action)

    def asked(action: "Action", _: "CaseAdvice") -> str | None:
        return ask(action.name, action.outcomes) if ask else None

    return asked
