"""The engine for unified-planning beside the library's own validator, grounder and examples."""

import io
import itertools
import re
from fractions import Fraction
from typing import Any

import pytest

from tests.places import TOP

pytest.importorskip("unified_planning")

from unified_planning.engines import CompilationKind, SequentialPlanValidator
from unified_planning.engines import PlanGenerationResultStatus as Status
from unified_planning.engines import ValidationResultStatus as Validity
from unified_planning.environment import get_environment
from unified_planning.exceptions import UPUsageError
from unified_planning.model import Fluent, InstantaneousAction, MinimizeActionCosts, Object, Problem
from unified_planning.model.metrics import MinimizeSequentialPlanLength
from unified_planning.plans import ActionInstance, PartialOrderPlan, SequentialPlan
from unified_planning.shortcuts import (
    AnytimePlanner,
    BoolType,
    Compiler,
    Equals,
    Forall,
    Iff,
    Int,
    Not,
    OneshotPlanner,
    PlanValidator,
    Real,
    Replanner,
    UserType,
    Variable,
)
from unified_planning.test.examples import get_example_problems

from cellwright.engine.formats.interop.up import CellwrightEngine

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning")
SOLVED = (Status.SOLVED_SATISFICING, Status.SOLVED_OPTIMALLY)
EXAMPLES = {
    name: each
    for name, each in get_example_problems().items()
    if CellwrightEngine.supports(each.problem.kind) and not each.problem.kind.has_continuous_time()
}


@pytest.fixture(autouse=True)
def _registered() -> None:
    environment = get_environment()
    environment.credits_stream = None
    if "cellwright" not in environment.factory.engines:
        environment.factory.add_engine(
            "cellwright", "cellwright.engine.formats.interop.up", "CellwrightEngine"
        )


def accepted(problem: Problem, plan: Any) -> bool:
    """What the library's own validator says."""
    return bool(SequentialPlanValidator().validate(problem, plan))


def solved(problem: Problem, **options: Any) -> Any:
    with OneshotPlanner(name="cellwright", params=options) as planner:
        return planner.solve(problem)


def validity(problem: Problem, plan: Any) -> Validity:
    with PlanValidator(name="cellwright") as validator:
        return validator.validate(problem, plan).status


def test_the_examples_of_a_supported_kind_are_many() -> None:
    assert len(EXAMPLES) >= 23


@pytest.mark.parametrize("name", EXAMPLES)
def test_examples_are_solved_when_they_can_be(name: str) -> None:
    example = EXAMPLES[name]
    result = solved(example.problem)
    assert (result.status in SOLVED) == example.solvable
    assert (result.status is Status.UNSOLVABLE_PROVEN) == (not example.solvable)
    if result.plan is not None:
        assert accepted(example.problem, result.plan)
    if result.status is Status.SOLVED_OPTIMALLY:
        assert cost(example.problem, result.plan) <= min(
            cost(example.problem, p) for p in example.valid_plans
        )


def cost(problem: Problem, plan: Any) -> Any:
    """What the library says that a plan is worth."""
    found = SequentialPlanValidator().validate(problem, plan)
    return found.metric_evaluations[problem.quality_metrics[0]]


@pytest.mark.parametrize("name", EXAMPLES)
def test_plans_of_examples_are_judged_as_the_library_does(name: str) -> None:
    example = EXAMPLES[name]
    for plan in [*example.valid_plans, *example.invalid_plans]:
        assert (validity(example.problem, plan) is Validity.VALID) == accepted(
            example.problem, plan
        )
    for plan in example.valid_plans:
        for left_out in range(len(plan.actions)):
            rest = SequentialPlan([a for n, a in enumerate(plan.actions) if n != left_out])
            assert (validity(example.problem, rest) is Validity.VALID) == accepted(
                example.problem, rest
            )


@pytest.mark.parametrize("name", EXAMPLES)
def test_partial_order_plans_are_valid_in_every_order(name: str) -> None:
    problem = EXAMPLES[name].problem
    result = solved(problem, partial_order=True)
    if result.plan is not None:
        assert isinstance(result.plan, PartialOrderPlan)
        assert validity(problem, result.plan) is Validity.VALID
        for plan in itertools.islice(result.plan.all_sequential_plans(), 100):
            assert accepted(problem, plan)


@pytest.mark.parametrize("name", EXAMPLES)
def test_grounded_examples_have_the_same_solutions(name: str) -> None:
    example = EXAMPLES[name]
    with Compiler(name="cellwright", compilation_kind=CompilationKind.GROUNDING) as compiler:
        compiled = compiler.compile(example.problem)
    assert all(not action.parameters for action in compiled.problem.actions)
    result = solved(compiled.problem)
    assert (result.status in SOLVED) == example.solvable
    if result.plan is not None:
        plan = result.plan.replace_action_instances(compiled.map_back_action_instance)
        assert accepted(example.problem, plan)


@pytest.mark.parametrize("name", EXAMPLES)
def test_anytime_plans_get_better(name: str) -> None:
    problem = EXAMPLES[name].problem
    with AnytimePlanner(name="cellwright") as planner:
        *before, last = planner.get_solutions(problem)
    assert all(each.status is Status.INTERMEDIATE for each in before)
    assert (last.status in SOLVED) == EXAMPLES[name].solvable
    for each in (*before, last):
        assert each.plan is None or accepted(problem, each.plan)
    if problem.quality_metrics:
        costs = [cost(problem, each.plan) for each in before]
        assert costs == sorted(set(costs), reverse=True)


def corridor(length: int = 3) -> Problem:
    """A robot goes along a corridor of rooms; a fluent of objects says where it is."""
    room = UserType("room")
    at, lit = Fluent("at", room), Fluent("lit", BoolType(), r=room)
    joined = Fluent("joined", BoolType(), a=room, b=room)
    problem = Problem("corridor")
    rooms = [Object(f"room {number}", room) for number in range(length)]
    problem.add_objects(rooms)
    for fluent in (lit, joined):
        problem.add_fluent(fluent, default_initial_value=False)
    problem.add_fluent(at, default_initial_value=rooms[0])
    for one, other in itertools.pairwise(rooms):
        problem.set_initial_value(joined(one, other), True)
    go = InstantaneousAction("Go", to=room)
    go.add_precondition(joined(at, go.parameter("to")))
    go.add_effect(at, go.parameter("to"))
    switch = InstantaneousAction("switch", here=room)
    here = switch.parameter("here")
    switch.add_precondition(Equals(here, at))
    switch.add_effect(lit(here), Not(lit(at)))
    problem.add_actions([go, switch])
    where = Variable("r", room)
    problem.add_goal(Forall(Iff(lit(where), Equals(where, at)), where))
    problem.add_goal(Equals(at, rooms[-1]))
    return problem


def test_fluents_of_objects_stand_inside_each_other() -> None:
    problem = corridor()
    result = solved(problem)
    assert [str(each) for each in result.plan.actions] == [
        "Go(room 1)",
        "Go(room 2)",
        "switch(room 2)",
    ]
    assert accepted(problem, result.plan)


def test_what_cannot_be_done_is_proved() -> None:
    problem = corridor()
    problem.set_initial_value(problem.fluent("joined")(*problem.all_objects[:2]), False)
    assert solved(problem).status is Status.UNSOLVABLE_PROVEN


def test_assignments_that_contradict_each_other_forbid_the_action() -> None:
    wall, paint = UserType("wall"), UserType("paint")
    problem, colour = Problem("painting"), Fluent("colour", paint, w=wall)
    walls, paints = (
        [Object("north", wall), Object("south", wall)],
        [Object("red", paint), Object("blue", paint)],
    )
    problem.add_objects([*walls, *paints])
    problem.add_fluent(colour, default_initial_value=paints[0])
    both = InstantaneousAction("both", a=wall, b=wall, c=paint, d=paint)
    both.add_effect(colour(both.parameter("a")), both.parameter("c"))
    both.add_effect(colour(both.parameter("b")), both.parameter("d"))
    problem.add_action(both)
    problem.add_goal(Equals(colour(walls[0]), paints[1]))
    as_term = problem.environment.expression_manager.ObjectExp
    for chosen in itertools.product(walls, walls, paints, paints):
        plan = SequentialPlan([ActionInstance(both, tuple(map(as_term, chosen)))])
        assert (validity(problem, plan) is Validity.VALID) == accepted(problem, plan)
    assert accepted(problem, solved(problem).plan)


def test_partial_order_plans_that_fail_in_one_order_are_invalid() -> None:
    problem = corridor(2)
    (go, switch) = (problem.action("Go"), problem.action("switch"))
    last = problem.environment.expression_manager.ObjectExp(problem.all_objects[-1])
    first, second = ActionInstance(go, (last,)), ActionInstance(switch, (last,))
    with PlanValidator(name="cellwright") as validator:
        assert validator.validate(problem, PartialOrderPlan({first: [second]}))
        result = validator.validate(problem, PartialOrderPlan({first: [], second: []}))
    assert result.status is Validity.INVALID
    assert result.reason is not None
    assert result.log_messages


def test_partial_order_plans_whose_orders_do_the_same_are_valid_although_they_interfere() -> None:
    problem = Problem("twice")
    done, clean = Fluent("done"), Fluent("clean")
    for fluent in (done, clean):
        problem.add_fluent(fluent, default_initial_value=False)
    actions = []
    for name in ("one", "other"):
        actions.append(InstantaneousAction(name))
        actions[-1].add_effect(done, True)
        actions[-1].add_effect(clean, Iff(clean, False))  # twice is as if never
    problem.add_actions(actions)
    problem.add_goal(done)
    problem.add_goal(Not(clean))
    assert (
        validity(problem, PartialOrderPlan({ActionInstance(each): [] for each in actions}))
        is Validity.VALID
    )


def priced(metric: Any = None) -> Problem:
    """Two ways to a goal: one step that costs 5/2, or two that cost 1/2 each."""
    problem = Problem("priced")
    facts = [Fluent(name) for name in ("half", "whole")]
    for each in facts:
        problem.add_fluent(each, default_initial_value=False)
    half, whole = facts
    leap, first, second = (InstantaneousAction(name) for name in ("leap", "first", "second"))
    leap.add_effect(whole, True)
    first.add_effect(half, True)
    second.add_precondition(half)
    second.add_effect(whole, True)
    problem.add_actions([leap, first, second])
    problem.add_goal(whole)
    costs = {leap: Real(Fraction(5, 2)), first: Real(Fraction(1, 2)), second: Real(Fraction(1, 2))}
    problem.add_quality_metric(metric or MinimizeActionCosts(costs))
    return problem


@pytest.mark.parametrize(("metric", "expected"), [(None, 1), (MinimizeSequentialPlanLength(), 1)])
def test_metrics_decide_which_plan_is_better(metric: Any, expected: Any) -> None:
    problem = priced(metric)
    result = solved(problem)
    assert result.status is Status.SOLVED_OPTIMALLY
    assert cost(problem, result.plan) == expected
    with PlanValidator(name="cellwright") as validator:
        assert validator.validate(problem, result.plan).metric_evaluations == {
            problem.quality_metrics[0]: expected
        }


def test_negative_costs_are_not_supported() -> None:
    problem = priced()
    problem.clear_quality_metrics()
    problem.add_quality_metric(MinimizeActionCosts({}, default=Int(-1)))
    result = solved(problem)
    assert result.status is Status.UNSUPPORTED_PROBLEM
    assert "not supported: negative costs" in str(result.log_messages[0])
    with pytest.raises(UPUsageError, match="negative costs"):
        CellwrightEngine().validate(problem, SequentialPlan([]))


@pytest.mark.slow
def test_universal_goals_over_many_objects_are_solved() -> None:
    problem = corridor(40)
    assert len(solved(problem).plan.actions) == 40


def test_no_time_is_a_timeout() -> None:
    with OneshotPlanner(name="cellwright") as planner:
        assert planner.solve(corridor(40), timeout=0).status is Status.TIMEOUT


def test_anytime_planning_uses_the_time_it_is_given() -> None:
    problem = EXAMPLES["hierarchical_blocks_world"].problem
    with AnytimePlanner(name="cellwright") as planner:
        *before, last = planner.get_solutions(problem, timeout=1)
    assert before
    assert last.status in SOLVED
    assert accepted(problem, last.plan)


def test_an_anytime_planner_may_be_left() -> None:
    with AnytimePlanner(name="cellwright") as planner:
        first = next(planner.get_solutions(corridor(10), timeout=600))
    assert first.status is Status.INTERMEDIATE


def test_results_are_written_to_a_stream_and_what_is_not_used_is_said() -> None:
    stream = io.StringIO()
    with pytest.warns(UserWarning, match="neither a heuristic nor an initial plan"):
        result = CellwrightEngine().solve(corridor(), heuristic=lambda _: 0.0, output_stream=stream)
    assert stream.getvalue() == f"{result}\n"


def test_other_kinds_are_refused() -> None:
    example = get_example_problems()["counter"].problem
    assert not CellwrightEngine.supports(example.kind)
    with pytest.raises(UPUsageError):
        CellwrightEngine().solve(example)


def test_a_replanner_keeps_what_is_left_of_its_plan() -> None:
    problem = corridor(6)
    problem.add_quality_metric(MinimizeSequentialPlanLength())
    at, rooms = problem.fluent("at"), problem.all_objects
    with Replanner(problem, name="cellwright") as replanner:
        before = list(map(str, replanner.resolve().plan.actions))
        for done in range(1, 6):
            replanner.update_initial_value(at, rooms[done])
            assert list(map(str, replanner.resolve().plan.actions)) == before[done:]
        replanner.update_initial_value(problem.fluent("lit")(rooms[1]), True)
        assert replanner.resolve().status is Status.UNSOLVABLE_PROVEN
        replanner.update_initial_value(at, rooms[0])
        changed = replanner.resolve().plan
        problem.set_initial_value(problem.fluent("lit")(rooms[1]), True)
        assert accepted(problem, changed)
        assert len(changed.actions) == len(before) + 1


def test_a_replanner_follows_what_changes() -> None:
    problem = corridor()
    at, (first, second, last) = problem.fluent("at"), problem.all_objects
    with Replanner(problem, name="cellwright") as replanner:
        assert len(replanner.resolve().plan.actions) == 3
        replanner.update_initial_value(at, second)
        assert len(replanner.resolve().plan.actions) == 2
        replanner.remove_goal(Equals(at, last))
        assert len(replanner.resolve().plan.actions) == 1
        replanner.add_goal(Equals(at, first))
        assert replanner.resolve().status is Status.UNSOLVABLE_PROVEN
        back = InstantaneousAction("back")
        back.add_effect(at, first)
        replanner.add_action(back)
        assert len(replanner.resolve().plan.actions) == 2
        replanner.remove_action("back")
        assert replanner.resolve().status is Status.UNSOLVABLE_PROVEN
        with pytest.warns(UserWarning, match="the action back"):
            replanner.remove_action("back")
    assert len(solved(problem).plan.actions) == 3


def test_what_the_page_shows_works() -> None:
    (shown,) = re.findall(
        r"```python\n(.*?)```", (TOP / "docs" / "unified-planning.md").read_text(), re.DOTALL
    )
    names: dict[str, Any] = {"problem": corridor()}
    exec(shown, names)
    assert accepted(names["problem"], names["result"].plan)
