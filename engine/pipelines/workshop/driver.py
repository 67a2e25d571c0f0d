"""The driver `workshop`: a scene in MuJoCo, whose arm really holds the target before a camera that makes images."""

from collections.abc import Callable

from cellwright.engine.pipelines.placing.camera_cell import CameraCell, seeing_of
from cellwright.engine.pipelines.placing.driver import OPTIONS, asked_for_scene
from cellwright.engine.pipelines.placing.seeing import Shows
from cellwright.engine.pipelines.simulator import HiddenCell, Simulator, fault_base, settings_of
from cellwright.engine.pipelines.workshop.shop import Workshop
from cellwright.engine.pipelines.workshop.showing import Showing
from cellwright.engine.ports import DriverSetup
from cellwright.engine.stages.geometry.world.model import World
from cellwright.kb.model.scene import Scene


def workshop(setup: DriverSetup) -> Simulator:
    """The cell of a scene for a run. Options: those of the simulator, `scene`, and those of its camera. Raises `InvalidInput`."""
    settings = settings_of(setup, OPTIONS)
    asked_for_scene(setup)
    seeing = seeing_of(setup.options, setup.seed, _in_physics)
    cell = HiddenCell(setup.problem, fault_base(setup.problem), settings.injections, setup.seed)
    return Simulator(CameraCell(cell, seeing), settings)


def _in_physics(scene: Scene) -> tuple[Shows, Callable[[], World]]:
    shop = Workshop(scene)
    return Showing(shop), shop.world
