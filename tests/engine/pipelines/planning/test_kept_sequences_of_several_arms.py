"""A kept sequence that several arms share: what is done stays, and the rest keeps its shares
until something changes.
"""

from pathlib import Path

import pytest
from typer.testing import CliRunner

from cellwright.engine.faces.cli import app
from cellwright.engine.model.outcome import Found
from cellwright.engine.pipelines.inspection.tour_progress import SequenceNews
from cellwright.engine.pipelines.planning.checked_plan import problem_of
from cellwright.engine.pipelines.planning.decomposition.kept_sequences import (
    SharedProgress,
    carry_on,
)
from cellwright.engine.pipelines.planning.plan_objective import plan_sequence
from cellwright.engine.stages.planning import SearchLimits
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.model.planning_problem import Problem


@pytest.fixture(scope="module")
def six() -> Problem:
    return problem_of("halves/six", "", "")


@pytest.fixture
def store(tmp_path: Path, six: Problem) -> str:
    target = str(tmp_path / "cell.db")
    kept(target, six)
    return target


def kept(store: str, problem: Problem, news: SequenceNews = SequenceNews()) -> SharedProgress:
    found = carry_on(store, problem, news)
    assert isinstance(found, SharedProgress)
    return found


def orders(found: SharedProgress) -> dict[str, list[str]]:
    """The visits that are left, by arm."""
    arms = sorted({each.arm for each in found.plan.rest})
    return {arm: [each.name for each in found.plan.rest if each.arm == arm] for arm in arms}


def test_shares_are_kept_with_the_next_visit_of_each_arm(store: str, six: Problem) -> None:
    found = kept(store, six)
    assert found.way == "kept"
    assert orders(found) == {"west": ["m1", "m2", "m3"], "east": ["m6", "m5", "m4"]}
    assert {arm: each.name for arm, each in found.ahead.items()} == {"west": "m1", "east": "m6"}


def test_arms_that_keep_to_their_orders_keep_their_shares(store: str, six: Problem) -> None:
    for done in ("m6", "m1", "m2"):
        assert kept(store, six, SequenceNews(done=(done,))).way == "kept"
    assert orders(kept(store, six)) == {"west": ["m3"], "east": ["m5", "m4"]}


def test_what_is_done_out_of_turn_leaves_every_other_visit_to_some_arm(
    store: str, six: Problem
) -> None:
    found = kept(store, six, SequenceNews(done=("m3", "m5")))
    assert sorted(name for own in orders(found).values() for name in own) == [
        "m1",
        "m2",
        "m4",
        "m6",
    ]
    assert [each.name for each in found.plan.done] == ["m3", "m5"]


@pytest.mark.parametrize("lost", ["east", "east_probe"])
def test_the_other_arm_takes_what_a_lost_one_has_left(store: str, six: Problem, lost: str) -> None:
    kept(store, six, SequenceNews(done=("m1",)))
    found = kept(store, six, SequenceNews(lost=(lost,)))
    assert found.way == "resequenced"
    assert set(orders(found)) == {"west"}
    assert found.moved["m6"] == ("east_probe of east", "west_probe of west")
    back = kept(store, six, SequenceNews(restored=(lost,)))
    assert set(orders(back)) == {"west", "east"}
    assert back.shared is not None
    assert found.shared is not None
    assert back.shared.shares.makespan < found.shared.shares.makespan


def test_without_any_arm_all_is_left_out_with_the_reason(store: str, six: Problem) -> None:
    found = kept(store, six, SequenceNews(lost=("east", "west")))
    assert found.plan.rest == ()
    assert "west_probe is not available" in found.plan.impossible["m1"]


def test_bad_and_unknown_visits(store: str, six: Problem) -> None:
    found = kept(store, six, SequenceNews(bad={"m2": "a scratch"}))
    assert found.dropped == {"m2": "a scratch"}
    assert "m2" not in {each.name for each in found.plan.rest}
    with pytest.raises(InvalidInput, match="K101"):
        kept(store, six, SequenceNews(done=("m9",)))


def test_nothing_is_left_when_all_is_done(store: str, six: Problem) -> None:
    found = kept(store, six, SequenceNews(done=("m1", "m6", "m2", "m5", "m3", "m4")))
    assert found.plan.rest == ()
    assert found.shared is None


def test_a_plan_follows_the_kept_shares(store: str, six: Problem) -> None:
    kept(store, six, SequenceNews(lost=("east",)))
    followed = plan_sequence(six, SearchLimits(), store=store)
    assert followed is not None
    assert isinstance(followed.outcome, Found)
    assert {str(each.resources[-1]) for each in followed.outcome.plan.steps} == {"west"}


@pytest.mark.parametrize(
    "option", [["--closed"], ["--cost", "joints"], ["--method", "exact"], ["--start", "m1"]]
)
def test_options_of_one_arm_are_refused_where_several_share(option: list[str]) -> None:
    result = CliRunner().invoke(app, ["sequence", "halves/six", *option])
    assert result.exit_code == 2, result.output
    assert "where several arms share" in " ".join(result.output.replace("│", " ").split())
