"""Behaviour trees of plans: ticked, they do what the plan does, as early as it may."""

import functools
import random
from collections.abc import Mapping
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from cellwright.engine.faces.cli import app
from cellwright.engine.formats.interop.behaviour_trees import write_behaviour_tree
from cellwright.engine.model.outcome import Found
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.pipelines.recovery.world_model import Dynamics
from cellwright.engine.stages.validation.condition_solving import condition_holds
from cellwright.kb.loader import load
from cellwright.kb.model.domain_model import Domain, Operator
from cellwright.kb.model.plan_model import Plan, Step, StepId
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.targets import find_target
from cellwright.kb.terms import Function, Variable
from tests.engine.formats.interop.ticking import Status, Tree
from tests.properties.problems import problems

WORK = Domain("work", operators=(Operator("work", (), None, ()),))  # type: ignore[arg-type]
LONG = ("themse/four", "themse/sentence")
BUNDLED = [
    "themse/one",
    "themse/four",
    "themse/sentence",
    "themse/furnace_of_two",
    "bulkhead/both_tools",
]


@st.composite
def orders(draw: st.DrawFn) -> Plan:
    """Steps in any partial order."""
    steps = []
    for number in range(1, draw(st.integers(0, 12)) + 1):
        before = draw(st.sets(st.integers(1, number - 1), max_size=3)) if number > 1 else set()
        after = tuple(StepId(each) for each in sorted(before))
        steps.append(
            Step(StepId(number), Function("work"), after, duration=draw(st.integers(1, 4)))
        )
    return Plan(tuple(steps))


class Workers:
    """Actions that take their time, and when each began and ended. `fails` is a step that fails."""

    def __init__(self, durations: Mapping[int, int], fails: int = 0) -> None:
        self.durations, self.fails, self.now = durations, fails, 0
        self.began: dict[int, int] = {}
        self.ended: dict[int, int] = {}

    def __call__(self, attributes: Mapping[str, str]) -> Status:
        number = int(attributes["name"].partition(":")[0])
        assert number not in self.ended, "an action that was done is ticked again"
        began = self.began.setdefault(number, self.now)
        if self.now < began + self.durations[number]:
            return Status.RUNNING
        self.ended[number] = self.now
        return Status.FAILURE if number == self.fails else Status.SUCCESS

    def run(self, tree: Tree) -> Status:
        """Tick until the tree ends."""
        while (status := tree.tick()) is Status.RUNNING:
            self.now += 1
            assert self.now < 10_000, "the tree never ends"
        return status


@given(orders())
def test_every_step_begins_as_soon_as_all_before_it_are_done_and_no_sooner(plan: Plan) -> None:
    workers = Workers({step.id: step.duration for step in plan.steps})
    assert workers.run(Tree(write_behaviour_tree(WORK, plan), workers)) is Status.SUCCESS
    for step in plan.steps:
        assert workers.began[step.id] == max(
            (workers.ended[each] for each in step.after), default=0
        )
    assert len(workers.ended) == len(plan.steps)


@given(orders(), st.data())
def test_a_step_that_fails_fails_the_tree_and_what_needs_it_never_begins(
    plan: Plan, data: st.DataObject
) -> None:
    if not plan.steps:
        return
    failing = data.draw(st.sampled_from(plan.steps)).id
    workers = Workers({step.id: step.duration for step in plan.steps}, failing)
    assert workers.run(Tree(write_behaviour_tree(WORK, plan), workers)) is Status.FAILURE
    behind = {each for each, before in plan.predecessors().items() if failing in before}
    assert not behind & {*workers.began}


def _acted_out(problem: Problem, plan: Plan, seed: int) -> None:
    """Tick the tree of a plan in the world of its problem, with durations of any length."""
    dynamics, draw = Dynamics(problem), random.Random(seed)
    steps = {step.id: step.operator for step in plan.steps}
    state = dynamics.start()
    workers = Workers({each: draw.randint(1, 9) for each in steps})

    def act(attributes: Mapping[str, str]) -> Status:
        nonlocal state
        number = StepId(int(attributes["name"].partition(":")[0]))
        assert dynamics.refusal(steps[number], state) == ""
        status = workers(attributes)
        if status is Status.SUCCESS:
            state = dynamics.after(steps[number], state)
        return status

    assert workers.run(Tree(write_behaviour_tree(problem.domain, plan), act)) is Status.SUCCESS
    assert condition_holds(problem.goal, dynamics.facts(state), {})
    assert all(state.reached[chain.name] == len(chain.stages) for chain in problem.chains)


@functools.cache
def _planned(target: str) -> tuple[Problem, Plan]:
    problem = load(find_target(target)).problem
    assert problem is not None
    found = checked_plan.plan_problem(problem)
    assert isinstance(found, Found)
    return problem, found.plan


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    "target",
    [pytest.param(each, marks=[pytest.mark.slow] if each in LONG else []) for each in BUNDLED],
)
def test_the_tree_of_a_bundled_plan_reaches_its_goals_whatever_the_durations(
    target: str, seed: int
) -> None:
    _acted_out(*_planned(target), seed)


@settings(max_examples=25, deadline=None)
@given(problems(), st.integers(0, 99))
def test_the_tree_of_a_plan_for_a_random_problem_reaches_its_goals(
    problem: Problem, seed: int
) -> None:
    found = checked_plan.plan_problem(problem)
    if isinstance(found, Found):
        _acted_out(problem, found.plan, seed)


def test_variables_whose_names_are_taken_get_ports_of_other_names() -> None:
    names = ("ID", "_ID", "ID_")
    operator = Operator("work", tuple(_parameter(each) for each in names), None, ())  # type: ignore[arg-type]
    step = Step(StepId(1), Function("work", tuple(Function(each) for each in "abc")))
    tree = Tree(
        write_behaviour_tree(Domain("work", operators=(operator,)), Plan((step,))),
        lambda _: Status.SUCCESS,
    )
    assert tree.models == {"work": {"ID_", "ID__", "ID___", "duration"}}
    assert tree.tick() is Status.SUCCESS


def _parameter(name: str) -> "object":
    from cellwright.kb.model.conditions import Parameter

    return Parameter(Variable(name), "thing")


def test_a_deep_order_is_written_without_deep_nesting() -> None:
    steps = [Step(StepId(1), Function("work"))]
    for number in range(2, 600, 2):
        after = (StepId(number - 1),) if number > 2 else (StepId(1),)
        steps += [
            Step(StepId(number), Function("work"), after),
            Step(StepId(number + 1), Function("work"), after),
        ]
    plan = Plan(tuple(steps))
    workers = Workers({step.id: 1 for step in plan.steps})
    assert workers.run(Tree(write_behaviour_tree(WORK, plan), workers)) is Status.SUCCESS


@pytest.mark.slow
def test_export_prints_the_tree_or_writes_it(tmp_path: Path) -> None:
    plan, tree = tmp_path / "plan.json", tmp_path / "tree.xml"
    made = CliRunner().invoke(app, ["plan", "themse/two", "--format", "json"])
    plan.write_text(made.stdout, "utf-8")
    printed = CliRunner().invoke(app, ["export", "bt", str(plan)])
    assert printed.exit_code == 0
    told = CliRunner().invoke(app, ["export", "bt", str(plan), "-o", str(tree)])
    assert told.stdout.replace("\n", "") == str(tree)
    assert tree.read_text("utf-8") == printed.stdout
    assert "<Parallel" in printed.stdout


def test_a_plan_that_is_wrong_is_not_exported(tmp_path: Path) -> None:
    plan = tmp_path / "plan.json"
    text = CliRunner().invoke(app, ["plan", "themse/one", "--format", "json"]).stdout
    plan.write_text(text.replace("open_drawer", "close_drawer"), "utf-8")
    refused = CliRunner().invoke(app, ["export", "bt", str(plan)])
    assert refused.exit_code == 1
    assert "<root" not in refused.stdout
    assert CliRunner().invoke(app, ["export", "bt", str(plan), "--ground"]).exit_code == 2
