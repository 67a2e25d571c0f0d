"""What the goals of a problem can need: examples from the bundled cells."""

from pathlib import Path

from cellwright.engine.stages.grounding import ground
from cellwright.engine.stages.grounding.goal_relevance import find_relevance
from cellwright.engine.stages.grounding.pruning import (
    drop_irrelevant_objects,
    drop_irrelevant_operators,
    preserves_optimality,
)
from cellwright.kb.loader import find_target, load, with_goals
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import ANYTHING, Function


def many(folder: Path, count: int, goals: str, more: str = "") -> Problem:
    """Points of which every third is a profile; the goals are given."""
    kinds = "".join(
        f"  - needs(m{n}, {'thickness' if n % 3 else 'profile'})\n" for n in range(1, count + 1)
    )
    kinds += "".join(
        f"  - position(m{n}, {n}000, {n * n % 90}000, 0)\n" for n in range(1, count + 1)
    )
    start = "initial:\n  - at(t3_746, in_contact_point(meas(m1)))\n  - holding(t3_746, us_probe)\n"
    path = folder / "many.yaml"
    path.write_text(
        "problem: many\ndomain: bulkhead\nobjects:\n  measurement: "
        f"[m1..{count}]\nstatics:\n{kinds}{more}{start}goals: []\n"
    )
    loaded = load(find_target(str(path)))
    assert loaded.problem is not None
    return with_goals(loaded.domain, goals, loaded.problem)


ONE = "measured(_, _, meas(m5))"


def test_what_is_measured_elsewhere_is_not_relevant(tmp_path: Path) -> None:
    needed = find_relevance(many(tmp_path, 9, ONE))
    place = Function("meas", (Function("m7"),))
    assert not needed.concerns(Function("measured", (ANYTHING, ANYTHING, place)))
    assert needed.concerns(
        Function("at", (Function("t3_746"), Function("approach_point", (place,))))
    )


def test_points_that_play_no_part_are_left_out(tmp_path: Path) -> None:
    small = drop_irrelevant_objects(many(tmp_path, 100, ONE))
    assert {"m1", "m5"}.isdisjoint(small.left_out)
    assert len(small.left_out) > 80


def test_a_point_of_many_takes_as_many_operators_as_one_of_fewer(tmp_path: Path) -> None:
    counts = set()
    for count in (60, 300):
        small = drop_irrelevant_objects(many(tmp_path, count, ONE))
        task = drop_irrelevant_operators(ground(small.problem))
        assert preserves_optimality(task, small.spares)
        counts.add(len(task.operators))
    assert len(counts) == 1


def test_no_object_is_left_out_of_a_small_problem() -> None:
    for name in ("bulkhead/both_tools", "themse/two"):
        problem = load(find_target(name)).problem
        assert problem is not None
        assert drop_irrelevant_objects(problem).problem is problem


def test_a_point_with_something_of_its_own_stays(tmp_path: Path) -> None:
    state = many(tmp_path, 60, ONE)
    marked = Function(
        "couplant_applied", (Function("goal_point", (Function("meas", (Function("m50"),)),)),)
    )
    own = state.replace((*drop_irrelevant_objects(state).problem.initial, marked))
    assert "m50" in drop_irrelevant_objects(own).left_out  # it does not matter for m5
    both = with_goals(state.domain, f"{ONE}, measured(_, _, meas(m50))", state)
    assert "m50" not in drop_irrelevant_objects(both).left_out
