"""Diagnosis: the cause of an exception found with the cheapest tests, and the whole decision tree."""

import random
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from cellwright.answers import Answer
from cellwright.requests import Deadline, Name, Target, limited, name_of

if TYPE_CHECKING:
    from rich.console import RenderableType

    from cellwright.engine.model.cases import Diagnosis
    from cellwright.engine.model.troubleshooting import Action, Advice, Tree, Troubleshooting
    from cellwright.engine.pipelines.troubleshooting import Desk
    from cellwright.engine.pipelines.troubleshooting.recovery import Recovery
    from cellwright.engine.stages.diagnosis.session import Answerer

Ask = Callable[[str, Sequence[str]], "str | None"]


@dataclass(frozen=True, repr=False)
class Diagnosed(Answer):
    """The end of a case: what was tested, what can still be the cause, and how the work goes on, if that was asked for."""

    diagnosis: "Diagnosis"
    recovery: "Recovery | None" = field(default=None, compare=False)
    desk: "Desk | None" = field(default=None, compare=False, repr=False)

    @property
    def status(self) -> str:
        """cured, isolated or open."""
        return "cured" if self.diagnosis.cured else "isolated" if self.diagnosis.isolated else "open"

    def data(self) -> Mapping[str, Any]:
        """The tests, the belief, what is certain, and the recovery."""
        from cellwright.engine.formats.report import diagnosis as report
        from cellwright.engine.formats.report import recovery

        desk = self._open
        content = report.case_entry(
            self.diagnosis, desk.certainties(self.diagnosis), desk.revision(self.diagnosis)
        )
        return content | ({"recovery": recovery.entry(self.recovery)} if self.recovery else {})

    def _renderable(self) -> "RenderableType":
        from rich.console import Group

        from cellwright.engine.formats.report import diagnosis as report
        from cellwright.engine.formats.report import recovery

        desk, made = self._open, self.diagnosis
        case = report.case(desk.model, made, desk.certainties(made), desk.revision(made))
        return Group(case, *([recovery.text(self.recovery)] if self.recovery else []))

    @property
    def _open(self) -> "Desk":
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
        from cellwright.engine.formats.report import diagnosis as report

        tree = report.tree_entry(self.problem, self.tree)
        return {"expected cost": round(self.expected_cost, 6), "bound": round(self.bound, 6), "tree": tree}

    def svg(self) -> str | None:
        """The tree as a picture."""
        from cellwright.engine.formats.report.decision_svg import decision_tree

        return decision_tree(self.problem, self.tree, self.expected_cost)

    def _renderable(self) -> "RenderableType":
        from cellwright.engine.formats.report import diagnosis as report

        return report.tree(self.problem, self.tree, self.expected_cost, self.bound)


def decision_tree(
    target: Target,
    exception: str,
    *,
    step: str = "",
    objective: Literal["isolate", "repair"] = "isolate",
    store: Name = "",
    seconds: float | None = None,
    expansions: int | None = None,
) -> DecisionTree:
    """The whole decision tree for an exception: at the least expected cost that is found. Raises `InvalidInput`, `TimeoutError`."""
    from cellwright.engine.model.troubleshooting import expected_cost

    with limited(seconds) as over:
        desk = _desk(target, exception, step, objective, store, expansions, over, None)
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
    objective: Literal["isolate", "repair"] = "isolate",
    recover: bool = False,
    store: Name = "",
    seconds: float | None = None,
    expansions: int | None = None,
    seed: int = 0,
) -> Diagnosed:
    """Find the cause of an exception. Outcomes of tests come from one of three: `ask`, `outcomes` or `hidden`.

    `ask` is called with the name of a test and its possible outcomes, and returns one of them, or None to end. `outcomes`
    lists them ("look_at_spot=dry, tool_self_test=passed"). `hidden` names the causes of a simulated fault. `plan` is the
    file of the plan that failed at `step`, `done` its steps that are done, `holds` and `gone` what is seen against the model.
    With `recover` the work is planned on. A `store` keeps the closed case and learns. Raises `InvalidInput`, `TimeoutError`.
    """
    from cellwright.engine.pipelines.troubleshooting.given import Failed, Seen
    from cellwright.engine.stages.diagnosis.session import run

    failed = Failed(Path(plan), step, done) if plan else None
    with limited(seconds) as over:
        desk = _desk(target, exception, step, objective, store, expansions, over, (failed, Seen(holds, gone)))
        made = run(desk.session, _answerer(desk, ask, outcomes, hidden, seed))
        if store:
            desk.keep(made, fspath(store))
        went_on = desk.recover(made, fspath(store)) if recover else None
    return Diagnosed(made, went_on, desk)


def _desk(
    target: Target,
    exception: str,
    step: str,
    objective: str,
    store: Name,
    expansions: int | None,
    over: Deadline,
    seen: Any,
) -> "Desk":
    from cellwright.engine.pipelines.troubleshooting import desk

    more = dict(zip(("failed", "seen"), seen, strict=True)) if seen else {}
    name = name_of(target)
    return desk(name, exception, step, objective, fspath(store), expansions, over, **more)


def _answerer(desk: "Desk", ask: Ask | None, outcomes: str, hidden: str, seed: int) -> "Answerer":
    from cellwright.engine.pipelines.troubleshooting.given import hidden_hypothesis, scripted
    from cellwright.engine.stages.diagnosis.world import HiddenWorld
    from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source

    if [bool(ask), bool(outcomes), bool(hidden)].count(True) != 1:
        hint = "give one of ask, outcomes and hidden; `decision_tree` needs none of them"
        raise InvalidInput(
            [Diagnostic(Source("diagnose"), "K409", "who says what tests show is not clear", hint)]
        )
    if outcomes:
        return scripted(desk.model, outcomes)
    if hidden:
        world = HiddenWorld(desk.model, hidden_hypothesis(desk.model, hidden), random.Random(seed))
        return lambda action, _: world.respond(action)

    def asked(action: "Action", _: "Advice") -> str | None:
        return ask(action.name, action.outcomes) if ask else None

    return asked
