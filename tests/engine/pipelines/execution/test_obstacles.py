"""Runs in which the arm meets what its model does not know: it joins the model, and another way
or another plan is found, or told.
"""

from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("numpy")

from cellwright.engine.model.motion_values import LegKind, MovedStep
from cellwright.engine.model.run_protocol import Finish, JournalRecord, RecordKind
from cellwright.engine.pipelines.execution import (
    RunRequest,
    RunScope,
    TimedOrders,
    begin_run,
    name_run,
    resume_run,
)
from cellwright.engine.pipelines.execution.journal_motions import Retracing
from cellwright.engine.pipelines.execution.run_motions import RunPaths, going_home
from cellwright.engine.pipelines.motion.moving_plan import plan_moving
from cellwright.engine.pipelines.motion.seen_bodies import SeenBody, with_seen
from cellwright.engine.pipelines.planning import plan_objective
from cellwright.engine.pipelines.planning.checked_plan import problem_of
from cellwright.engine.pipelines.simulators.obstructed_arm import subdivide_path
from cellwright.engine.plugins import geometry_backend
from cellwright.engine.stages.geometry.collision.builtin import BuiltinChecker
from cellwright.engine.stages.geometry.collision.planning_scene import PlanningScene
from cellwright.engine.stages.geometry.world.collision_scene import collision_scene_of
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.engine.stages.planning import SearchLimits
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.loader.cell import cell_of
from cellwright.kb.model.body_shapes import Pose
from cellwright.kb.model.planning_problem import Problem
from tests.engine.pipelines.motion.test_moving_plan import SUITS, kiln_room

CRATE = "cell: surprise\nfixtures:\n  {name}: {{at: [{at}], shapes: [{{box: [{box}]}}]}}\n"
WRONG = {
    "without bodies": "cell: surprise\n",
    "without shapes": "cell: surprise\nfixtures:\n  crate: {at: [0, 0, 1]}\n",
    "with an arm": "cell: surprise\narms:\n  other: {model: ur5}\n",
    "empty": "\n",
    "a list": "- crate\n",
}


class Killed(BaseException):
    """The process is gone."""


def room(folder: Path, brick: str = "shelf", suits: tuple[str, ...] = SUITS) -> str:
    """The kiln room, with the brick believed to be somewhere."""
    folder.mkdir(exist_ok=True)
    kiln_room(folder, 1.5, suits)
    path = folder / "problems" / "fire.yaml"
    path.write_text(
        path.read_text().replace('"at(brick, top)"]\ngoals', f'"at(brick, {brick})"]\ngoals')
    )
    return str(path)


def crate(folder: Path, at: str, box: str, name: str = "crate") -> str:
    path = folder / "crate.yaml"
    path.write_text(CRATE.format(name=name, at=at, box=box))
    return str(path)


def wanted(folder: Path, target: str, **options: str) -> RunRequest:
    return RunRequest(target, store=str(folder / "j.db"), options=options, motion=True)


def executed(
    asked: RunRequest, kill_after: int = 0, *seen: SeenBody
) -> tuple[Finish, list[JournalRecord]]:
    """The ending of a run with motion, and its records. It may be killed after so many steps and
    taken up again.

    What was `seen` since the plan was made stands in the cell.
    """
    told = problem_of(asked.target)
    moving = plan_moving(told, cell_of(asked.target), geometry_backend(), planned)
    assert moving.walk is not None
    home = going_home(moving.walk.cell, moving.steps)
    paths = RunPaths(moving.problem, moving.walk.cell, planned=moving.walk, home=home)
    paths.sees(seen, frozenset())
    entered, records, done = name_run(asked, told), list[JournalRecord](), 0

    def heard(record: Any) -> None:
        nonlocal done
        records.append(record)
        done += record.kind is RecordKind.DONE
        if kill_after and done == kill_after:
            raise Killed

    scope = RunScope(moving.problem, moving.given_up)
    try:
        ending = begin_run(
            entered,
            told,
            TimedOrders(),
            [heard],
            table=moving.run.timetable,
            scope=scope,
            paths=paths,
        )
    except Killed:
        ending = resume_run(entered.store, entered.run, TimedOrders(), [records.append])
    assert isinstance(ending, Finish)
    return ending, records


def planned(problem: Problem) -> plan_objective.Run:
    return plan_objective.plan_for_objective(problem, SearchLimits(20_000))


def actions(records: list[JournalRecord]) -> list[str]:
    return [each.content["action"] for each in records if each.kind is RecordKind.DONE]


def corrections(records: list[JournalRecord]) -> list[dict[str, Any]]:
    return [dict(each.content) for each in records if each.kind is RecordKind.WORLD]


def test_what_is_met_joins_the_model_and_another_path_leads_around_it(tmp_path: Path) -> None:
    target = room(tmp_path / "room")
    free, _ = executed(wanted(tmp_path, target))
    file = crate(tmp_path, "0.5, 0.0, 0.2", "0.06, 0.06, 0.4")
    ending, records = executed(wanted(tmp_path, target, obstacles=file))
    assert (free.outcome, free.exceptions) == ("reached", 0)
    assert (ending.outcome, ending.exceptions) == ("reached", 1)
    assert "the arm met crate; planned anew" in ending.story[0]
    (seen,) = corrections(records)
    assert seen["bodies"] == {
        "crate": {"at": [0.5, 0.0, 0.2], "rpy": [0.0, 0.0, 0.0], "box": [0.06, 0.06, 0.4]}
    }
    assert actions(records) == ["pick(bolt, bench)", "put(bolt, kiln)"]
    assert ending.makespan_ms > free.makespan_ms


def test_a_known_body_that_stands_elsewhere_is_moved_first(tmp_path: Path) -> None:
    target = room(tmp_path / "room")
    ending, records = executed(wanted(tmp_path, target, really="at(brick, top); -at(brick, shelf)"))
    assert ending.outcome == "reached"
    (seen,) = corrections(records)
    assert seen["adds"] == ["at(brick, top)", "free(shelf)"]
    assert seen["ends"] == ["at(brick, shelf)", "free(top)"]
    assert [each for each in actions(records) if "brick" in each] == [
        "pick(brick, top)",
        "put(brick, shelf)",
    ]
    assert actions(records)[-1] == "put(bolt, kiln)"


def test_where_no_way_is_left_the_run_stops_with_the_reason(tmp_path: Path) -> None:
    target = room(tmp_path / "room")
    file = crate(tmp_path, "0.45, 0.2, 0.25", "0.2, 0.2, 0.1")
    ending, _ = executed(wanted(tmp_path, target, obstacles=file))
    assert ending.outcome == "stopped"
    assert "put(bolt, kiln) has no motion" in ending.why
    assert "crate" in ending.why


def test_a_run_is_retraced_with_what_its_arm_has_met(tmp_path: Path) -> None:
    """The arm goes back from what it meets, and the step that follows begins where it was
    before, around that body.
    """
    target = room(tmp_path / "room")
    _, records = executed(
        wanted(tmp_path, target, obstacles=crate(tmp_path, "0.5, 0.0, 0.2", "0.06, 0.06, 0.4"))
    )
    retracing = Retracing.of(problem_of(target), cell_of(target), geometry_backend())
    taken = [found for each in records if (found := retracing.take(each)) is not None]
    stopped = {
        each.content["command"] for each in records if each.content.get("text") == "obstructed"
    }
    (met,) = [n for n, each in enumerate(taken) if each.command in stopped]
    first, again = taken[met].motion, taken[met + 1].motion
    assert isinstance(first, MovedStep)
    assert isinstance(again, MovedStep)
    assert (first.legs[0].path[0] == again.legs[0].path[0]).all()
    whole = SeenBody("crate", Pose((0.5, 0.0, 0.2)), (0.06, 0.06, 0.4))
    world = GeometricWorld.of(with_seen(cell_of(target), [whole]))
    ground = PlanningScene(BuiltinChecker(collision_scene_of(world)))
    touches = [
        any(
            ground.collides(subdivide_path(leg.path)).any()
            for leg in each.legs
            if leg.kind is LegKind.WAY
        )
        for each in (first, again)
    ]
    assert touches == [True, False]


def test_a_step_that_has_no_motion_any_more_is_not_sent(tmp_path: Path) -> None:
    target = room(tmp_path / "room")
    screen = SeenBody("screen", Pose((0.45, 0.2, 0.25)), (0.2, 0.2, 0.1))
    ending, records = executed(wanted(tmp_path, target), 0, screen)
    replies = [each.content for each in records if each.kind is RecordKind.REPLY]
    assert [each["text"] for each in replies] == ["done", "no_motion"]
    assert "screen" in replies[-1]["data"]["why"]
    assert (ending.outcome, ending.steps) == ("stopped", 1)
    assert ending.makespan_ms == next(
        each.at_ms for each in records if each.kind is RecordKind.DONE
    )


@pytest.mark.slow
@pytest.mark.parametrize("steps", [1, 2])
def test_a_run_that_is_killed_knows_what_it_has_met_and_where_its_arm_is(
    steps: int, tmp_path: Path
) -> None:
    target = room(tmp_path / "room")
    options = {"really": "at(brick, top); -at(brick, shelf)"}
    whole, one = executed(wanted(tmp_path, target, **options))
    ending, two = executed(wanted(tmp_path, target, **options), kill_after=steps)
    assert actions(one) == actions(two)
    assert (ending.outcome, ending.makespan_ms) == (whole.outcome, whole.makespan_ms)
    arms = [
        [each.content["arms"] for each in found if each.kind is RecordKind.DONE]
        for found in (one, two)
    ]
    assert arms[0] == arms[1]


def test_without_motion_a_run_stops_where_its_arm_meets_something(tmp_path: Path) -> None:
    target = room(tmp_path / "room")
    file = crate(tmp_path, "0.5, 0.0, 0.2", "0.06, 0.06, 0.4")
    asked = RunRequest(target, store=str(tmp_path / "j.db"), options={"obstacles": file})
    told = problem_of(target)
    ending = begin_run(name_run(asked, told), told, TimedOrders())
    assert isinstance(ending, Finish)
    assert ending.outcome == "stopped"
    assert "--motion" in ending.why


@pytest.mark.parametrize(
    ("options", "code"),
    [
        ({"really": "at(brick, nowhere)"}, "K103"),
        ({"really": "stands(brick)"}, "K101"),
        ({"obstacles": "nothing.yaml"}, "K001"),
        ({"obstacles": "oven"}, "K104"),
        ({"obstacles": "without bodies"}, "K405"),
        ({"obstacles": "without shapes"}, "K405"),
        ({"obstacles": "with an arm"}, "K405"),
        ({"obstacles": "empty"}, "K002"),
        ({"obstacles": "a list"}, "K005"),
    ],
)
def test_what_cannot_be_hidden_is_told(options: dict[str, str], code: str, tmp_path: Path) -> None:
    target = room(tmp_path / "room")
    if options.get("obstacles") == "oven":
        options = {"obstacles": crate(tmp_path, "0, 0, 0", "1, 1, 1", name="oven")}
    elif options.get("obstacles") in WRONG:
        (tmp_path / "wrong.yaml").write_text(WRONG[options["obstacles"]])
        options = {"obstacles": str(tmp_path / "wrong.yaml")}
    asked, told = wanted(tmp_path, target, **options), problem_of(target)
    with pytest.raises(InvalidInput) as error:
        begin_run(name_run(asked, told), told, TimedOrders())
    assert [each.code for each in error.value.diagnostics] == [code]
    assert "domain:" not in error.value.diagnostics[0].hint
