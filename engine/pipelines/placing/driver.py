"""The driver `camera`: the simulated cell, with a camera of a scene that really makes images."""

from cellwright.engine.pipelines.placing.camera_cell import CameraCell, seeing_of
from cellwright.engine.pipelines.simulator import HiddenCell, Simulator, fault_base, settings_of
from cellwright.engine.ports import DriverSetup
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source

OPTIONS = ("scene", "calibration", "maps", "moved", "lens", "depths")


def with_camera(setup: DriverSetup) -> Simulator:
    """The simulated cell of a scene for a run. Options: those of the simulator, `scene`, and those of its camera. Raises `InvalidInput`."""
    settings = settings_of(setup, OPTIONS)
    asked_for_scene(setup)
    cell = HiddenCell(setup.problem, fault_base(setup.problem), settings.injections, setup.seed)
    return Simulator(CameraCell(cell, seeing_of(setup.options, setup.seed)), settings)


def asked_for_scene(setup: DriverSetup) -> None:
    """Refuse options without a scene. Raises `InvalidInput`."""
    if "scene" not in setup.options:
        hint = "name a scene: --option scene=domains/handey/scene.yaml"
        raise InvalidInput([Diagnostic(Source("--option"), "K408", "this driver needs a scene", hint)])
