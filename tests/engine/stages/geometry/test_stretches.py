"""Batches over threads."""

import numpy as np
import pytest

from cellwright.engine.stages.geometry.collision.builtin import BuiltinBackend
from cellwright.engine.stages.geometry.core_threads import STRETCH_ROWS, run_in_stretches
from cellwright.engine.stages.geometry.kinematics.arm_model import ArmModel
from cellwright.engine.stages.geometry.world.collision_scene import collision_scene_of
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.kb.loader import bundled_domains
from cellwright.kb.loader.cell import load_cell


@pytest.mark.parametrize("threads", ["1", "3"])
@pytest.mark.parametrize("count", [0, 1, STRETCH_ROWS, STRETCH_ROWS + 1, 5 * STRETCH_ROWS + 7])
def test_every_row_is_done_once(threads: str, count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CELLWRIGHT_THREADS", threads)
    done = np.zeros(count, dtype=int)

    def work(first: int, after: int) -> None:
        done[first:after] += 1

    run_in_stretches(count, work)
    assert (done == 1).all()


def test_what_goes_wrong_in_a_thread_is_told() -> None:
    def work(first: int, after: int) -> None:
        raise ValueError(f"{first} to {after}")

    with pytest.raises(ValueError, match="0 to"):
        run_in_stretches(3 * STRETCH_ROWS, work)


def test_answers_do_not_depend_on_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    world = GeometricWorld.of(load_cell(bundled_domains()["themse"] / "cell.yaml"))
    checker = BuiltinBackend().checker(collision_scene_of(world))
    model: ArmModel = world.models["manutec_r3"]
    q = model.random(3 * STRETCH_ROWS, np.random.default_rng(4))
    answers = []
    for threads in ("1", "2"):
        monkeypatch.setenv("CELLWRIGHT_THREADS", threads)
        answers.append((checker.collides(q), checker.clearance(q, 0.2)))
    assert np.array_equal(answers[0][0], answers[1][0])
    assert np.array_equal(answers[0][1], answers[1][1])
