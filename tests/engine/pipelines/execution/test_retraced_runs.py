"""The motions of a run are found from its journal: what is planned for its steps, in the time
that they took.
"""

import struct
from itertools import pairwise

import numpy as np
import pytest

from cellwright.engine.model.motion_values import MovedStep
from cellwright.engine.pipelines.execution import RunRequest, TimedOrders, begin_run, name_run
from cellwright.engine.pipelines.execution.journal_motions import (
    RestingCell,
    Retracing,
    TakenStep,
    step_stretches,
    tool_path,
    world_during,
)
from cellwright.engine.pipelines.execution.record_shapes import read_record
from cellwright.engine.pipelines.planning.checked_plan import problem_of
from cellwright.engine.plugins import geometry_backend
from cellwright.engine.stages.geometry.pictures.viewer_files import (
    body_poses,
    body_triangles,
    stl_of_triangles,
)
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.kb.loader.cell import cell_of
from cellwright.kb.store.journal import Journal

pytestmark = pytest.mark.slow
TARGET = "themse/in_furnace"


@pytest.fixture(scope="module")
def steps(tmp_path_factory: pytest.TempPathFactory) -> list[TakenStep]:
    store = str(tmp_path_factory.mktemp("store") / "runs.db")
    problem = problem_of(TARGET)
    wanted = name_run(RunRequest(TARGET, store=store, run="monday"), problem)
    begin_run(wanted, problem, TimedOrders())
    with Journal(store) as journal:
        records = [read_record(line) for line in journal.lines("monday", 0)]
    retracing = Retracing.of(problem, cell_of(TARGET), geometry_backend())
    return [taken for each in records if (taken := retracing.take(each)) is not None]


@pytest.fixture(scope="module")
def resting() -> RestingCell:
    return RestingCell(cell_of(TARGET))


def test_every_step_of_the_arm_has_a_motion(steps: list[TakenStep]) -> None:
    assert len(steps) == 4
    assert all(isinstance(each.motion, MovedStep) and each.motion.proved for each in steps)


def test_each_step_begins_where_the_one_before_it_has_ended(
    steps: list[TakenStep], resting: RestingCell
) -> None:
    for one, other in pairwise(steps):
        ended, begun = world_during(resting, one, 1.0), world_during(resting, other, 0.0)
        assert begun.configuration == pytest.approx(ended.configuration, abs=1e-9)


def test_nothing_jumps_during_a_step(steps: list[TakenStep], resting: RestingCell) -> None:
    names = list(body_triangles(GeometricWorld.of(resting.home.cell)))
    for taken in steps:
        worlds = [world_during(resting, taken, share) for share in np.linspace(0.0, 1.0, 60)]
        placed = [body_poses(world, names) for world in worlds]
        for one, other in pairwise(placed):
            assert max(np.abs(one[n][:3, 3] - other[n][:3, 3]).max() for n in names) < 0.3


def test_the_stretches_of_a_motion_last_as_long_as_the_step(steps: list[TakenStep]) -> None:
    for taken in steps:
        assert isinstance(taken.motion, MovedStep)
        parts = step_stretches(taken.motion)
        assert sum(each.seconds for each in parts) == pytest.approx(taken.motion.seconds)


def test_the_path_of_the_tool_is_that_of_the_world(
    steps: list[TakenStep], resting: RestingCell
) -> None:
    path = tool_path(resting, steps[0], 5)
    for point, share in zip(path, np.linspace(0.0, 1.0, 5), strict=True):
        world = world_during(resting, steps[0], float(share))
        assert point == pytest.approx(
            world.pose("world", f"{next(iter(world.cell.arms))}.tool")[:3, 3]
        )


def test_surfaces_as_stl_are_read_back(resting: RestingCell) -> None:
    for name, triangles in body_triangles(resting.home).items():
        data = stl_of_triangles(triangles)
        (count,) = struct.unpack_from("<I", data, 80)
        assert (count, len(data)) == (len(triangles), 84 + 50 * len(triangles)), name
        read = np.frombuffer(data[84:], dtype="<u1").reshape(count, 50)[:, 12:48].copy().view("<f4")
        assert read.reshape(-1, 3, 3) == pytest.approx(triangles, abs=1e-6)
