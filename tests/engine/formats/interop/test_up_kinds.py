"""Kinds of unified-planning problems that the engine does not take are refused, whatever their
features are.
"""

from typing import Any

import pytest

pytest.importorskip("unified_planning")

from unified_planning.engines import PlanGenerationResultStatus as Status
from unified_planning.environment import get_environment
from unified_planning.exceptions import UPUsageError
from unified_planning.model import Fluent, InstantaneousAction, Object, Problem, ProblemKind
from unified_planning.model.problem_kind import FEATURES
from unified_planning.model.problem_kind_versioning import LATEST_PROBLEM_KIND_VERSION
from unified_planning.plans import ActionInstance, SequentialPlan
from unified_planning.shortcuts import (
    Always,
    And,
    BoolType,
    ClosedTimeInterval,
    Exists,
    Forall,
    GlobalEndTiming,
    GlobalStartTiming,
    MaximizeExpressionOnFinalState,
    MinimizeMakespan,
    Oversubscription,
    PlanValidator,
    Sometime,
    UserType,
    Variable,
)

from cellwright.engine.formats.interop.up import CellwrightEngine
from cellwright.engine.formats.interop.up.up_kinds import TIMED_FEATURES
from cellwright.engine.formats.interop.up.up_kinds import UP_FEATURES as TAKEN

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::UserWarning")
TIMES = {"CONTINUOUS_TIME", "DISCRETE_TIME"}  # a kind with one of these is a kind with times
EVERY = sorted(feature for group in FEATURES.values() for feature in group)


@pytest.fixture(autouse=True)
def _registered() -> None:
    environment = get_environment()
    environment.credits_stream = None
    if "cellwright" not in environment.factory.engines:
        environment.factory.add_engine(
            "cellwright", "cellwright.engine.formats.interop.up", "CellwrightEngine"
        )


def simple(kind: type[Problem] = Problem) -> Problem:
    problem = kind("simple")
    done = problem.add_fluent("done", BoolType(), default_initial_value=False)
    action = InstantaneousAction("do")
    action.add_effect(done, True)
    problem.add_action(action)
    problem.add_goal(done())
    return problem


def said(problem: Problem) -> tuple[Status, str]:
    engine = CellwrightEngine()
    result = engine._solve(problem)
    assert result.plan is None or result.status in (
        Status.SOLVED_OPTIMALLY,
        Status.SOLVED_SATISFICING,
    )
    return result.status, " ".join(each.message for each in result.log_messages)


def kind_with(features: set[str]) -> ProblemKind:
    """The kind with these features, in the newest version of kinds that has all of them."""
    kinds = (ProblemKind(features, version=n) for n in range(LATEST_PROBLEM_KIND_VERSION, 0, -1))
    return next(each for each in kinds if features <= set(each.features))


@pytest.mark.parametrize("feature", EVERY)
def test_a_feature_is_taken_or_refused_by_its_name(feature: str) -> None:
    class Featured(Problem):  # type: ignore[misc]
        @property
        def kind(self) -> ProblemKind:
            return kind_with({*super().kind.features, feature})

    problem = simple(Featured)
    plan = SequentialPlan([ActionInstance(problem.action("do"))])
    status, message = said(problem)
    engine = CellwrightEngine()
    assert engine.supports(problem.kind) == (feature in TAKEN or feature in TIMES)
    if feature in TAKEN:
        assert status is Status.SOLVED_SATISFICING
        return
    if feature in TIMES:
        assert status is Status.SOLVED_SATISFICING
    else:
        assert status is Status.UNSUPPORTED_PROBLEM
        assert feature.lower().replace("_", " ") in message
    with pytest.raises(UPUsageError, match=feature.lower().replace("_", " ")):
        engine._validate(problem, plan)


def timed_effect(problem: Problem) -> None:
    problem.add_timed_effect(GlobalStartTiming(5), problem.fluent("done"), True)


def timed_goal(problem: Problem) -> None:
    problem.add_timed_goal(
        ClosedTimeInterval(GlobalStartTiming(), GlobalEndTiming()), problem.fluent("done")()
    )


def always(problem: Problem) -> None:
    problem.add_trajectory_constraint(Always(problem.fluent("done")()))


def sometime(problem: Problem) -> None:
    problem.add_trajectory_constraint(Sometime(problem.fluent("done")()))


def oversubscribed(problem: Problem) -> None:
    problem.add_quality_metric(Oversubscription({problem.fluent("done")(): 5}))


def final_value(problem: Problem) -> None:
    number = problem.add_fluent("number", default_initial_value=1)
    problem.add_quality_metric(MaximizeExpressionOnFinalState(number()))


def makespan(problem: Problem) -> None:
    problem.add_quality_metric(MinimizeMakespan())


@pytest.mark.parametrize(
    "further",
    [timed_goal, always, sometime, oversubscribed, makespan],
    ids=lambda each: each.__name__,
)
def test_what_the_library_only_warns_of_is_refused(further: Any) -> None:
    problem = simple()
    further(problem)
    assert said(problem)[0] is Status.UNSUPPORTED_PROBLEM
    with pytest.raises(UPUsageError), PlanValidator(name="cellwright") as validator:
        validator.validate(problem, SequentialPlan([ActionInstance(problem.action("do"))]))


@pytest.mark.parametrize("feature", EVERY)
def test_a_feature_beside_times_is_taken_or_refused_by_its_name(feature: str) -> None:
    class Featured(Problem):  # type: ignore[misc]
        @property
        def kind(self) -> ProblemKind:
            return kind_with({*super().kind.features, "CONTINUOUS_TIME", feature})

    problem = simple(Featured)
    problem.add_object("bolt", UserType("part", UserType("thing")))
    status, message = said(problem)
    assert CellwrightEngine.supports(problem.kind) == (feature in TIMED_FEATURES)
    assert (status is Status.SOLVED_SATISFICING) == (feature in TIMED_FEATURES)
    if feature not in TIMED_FEATURES:
        assert feature.lower().replace("_", " ") in message


def test_the_validator_refuses_timed_effects() -> None:
    problem = simple()
    timed_effect(problem)
    with pytest.raises(UPUsageError), PlanValidator(name="cellwright") as validator:
        validator.validate(problem, SequentialPlan([ActionInstance(problem.action("do"))]))


def test_a_quantified_variable_hides_those_of_the_same_name() -> None:
    """`x` is a parameter, a variable of an effect, and a variable of two types in the
    precondition and the goal.
    """
    problem = Problem("names")
    thing = UserType("thing")
    part = UserType("part", thing)
    near = Fluent("near", BoolType(), one=thing, other=thing)
    done = Fluent("done")
    for fluent in (near, done):
        problem.add_fluent(fluent, default_initial_value=False)
    a, b = Object("a", thing), Object("b", part)
    problem.add_objects([a, b])
    problem.set_initial_value(near(a, b), True)
    x, own = Variable("x", thing), Variable("x", part)
    action = InstantaneousAction("do", x=thing)
    parameter = action.parameter("x")
    inner = Exists(And(near(x, own), Exists(near(a, x), x)), own)
    action.add_precondition(And(Exists(near(parameter, x), x), Exists(inner, x)))
    action.add_effect(near(x, x), True, Exists(near(a, x), x), forall=[x])
    action.add_effect(done, True)
    problem.add_action(action)
    problem.add_goal(And(done, Forall(And(near(x, x), Exists(near(a, x), x)), x)))
    result = CellwrightEngine()._solve(problem)
    assert [str(each) for each in result.plan.actions] == ["do(a)"]
