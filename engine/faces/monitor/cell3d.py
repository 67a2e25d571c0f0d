"""The 3D view of a cell: arms in motion, what they hold, obstacles they met, and the path being
moved.
"""

import json
from collections.abc import Mapping, Sequence
from typing import Any

from nicegui import background_tasks, events, ui
from nicegui.elements.scene.scene_object3d import Object3D

from cellwright.engine.faces.monitor.cell_bodies import CellBodies
from cellwright.engine.faces.monitor.chosen_item import names_any
from cellwright.engine.faces.monitor.view_base import RunView
from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.model.motion_values import Unmoved
from cellwright.engine.model.run_protocol import BODIES_SEEN
from cellwright.engine.pipelines.execution.journal_motions import TakenStep, tool_path
from cellwright.engine.pipelines.execution.plan_records import read_ground_atom
from cellwright.engine.pipelines.motion.seen_bodies import seen_in
from cellwright.kb.diagnostics import InvalidInput

RED, CHOSEN, MET = "#e01818", "#d02090", "#e08a18"
VIEW_SIDES = {  # the direction from which it is seen
    "front": (0.0, -1.0, 0.15),
    "right": (1.0, 0.0, 0.15),
    "back": (0.0, 1.0, 0.15),
    "left": (-1.0, 0.0, 0.15),
    "top": (0.0, -0.01, 1.0),
    "corner": (-0.6, -0.75, 0.55),
}
VIEW_UP = (0.0, 0.0, 1.0)
PLACING_SCRIPT = """
const WANTED = {};
function placed(scene, poses) {
  WANTED[scene] = Object.assign(WANTED[scene] || {}, poses);
}
setInterval(() => {
  for (const scene in WANTED) {
    const view = getElement(Number(scene));
    if (!view || !view.objects) continue;
    const seen = {};
    for (const [id, pose] of Object.entries(WANTED[scene])) {
      const mesh = view.objects.get(id)?.mesh;
      if (!mesh || !mesh.parent) continue;
      mesh.matrixAutoUpdate = false;
      mesh.matrix.set(...pose);
      mesh.updateMatrixWorld(true);
      seen[mesh.name] = Array.from(mesh.matrixWorld.elements);
    }
    view.$el.dataset.poses = JSON.stringify(seen);
  }
}, 50);
"""


class Cell3D(RunView):
    """The cell as it is now, or at the time that is looked at."""

    name = "cell"

    def make(self) -> None:
        """Make what is shown, still empty."""
        self._path_of, self._painted = 0, dict[str, str]()
        self._sent = dict[str, tuple[float, ...]]()
        self._boxes = dict[str, tuple[float, float, float]]()
        try:
            self._solids: CellBodies | None = self.look.shared.solids(self.look.follower.run)
        except InvalidInput as refused:
            self._solids = None
            ui.label(refused.diagnostics[0].message)
            return
        with ui.row().classes("items-center gap-2"):
            for side in VIEW_SIDES:
                ui.button(side, on_click=lambda _, side=side: self._turn(side)).props(
                    f'dense no-caps outline data-testid="view-{side}"'
                )
            self._touching = ui.label("").props('data-testid="touching" role="status"')
            self._motion = ui.label("").props('data-testid="motion"')
        self._scene, self._bodies = body_scene(self._solids, clicks=["dblclick"])
        self._scene.on_click(self._clicked)
        with self._scene:
            self._path = self._scene.point_cloud([], [], 0.012)
        self._turn("corner", 0.0)

    def sign(self) -> object:
        """How far motions are found."""
        return None if self._solids is None else self.look.shared.motions(self.look.run.run).looked

    def _clicked(self, event: events.SceneClickEventArguments) -> None:
        """A double click chooses a body."""
        body_name = next(
            (hit.object_name for hit in event.hits if hit.object_name in self._bodies), ""
        )
        if body_name:
            self.look.choose(body_name)

    def _turn(self, side: str, seconds: float = 0.5) -> None:
        assert self._solids is not None
        turn_camera(self._scene, self._solids, side, seconds)

    def show(self) -> None:
        """Show the run as it stands."""
        if self._solids is None:
            return
        run, look = self.look.run, self.look
        background_tasks.create_lazy(look.shared.find_motions(run.run), name=f"motions {run.run}")
        motions = look.shared.motions(run.run)
        taken = [motion for motion in motions.at(run.number) if motion.command not in run.stopped]
        last = taken[-1] if taken else None
        share = look.share(last) if last is not None else 1.0
        world = self._solids.world(taken, share, list(map(read_ground_atom, run.holds)))
        poses = self._solids.poses(world) | self._met(run.met)
        self._place({name: tuple(pose.ravel().round(6)) for name, pose in poses.items()})
        self._paint(self._solids.touching(world, last))
        self._draw_path(last if share < 1.0 else None)
        self._motion.set_text(
            motions.why_none or _motion_text(last, share, motions.looked < run.number)
        )

    def _met(self, told: Mapping[str, Any]) -> dict[str, Floats]:
        """Where the bodies are that the arm has met, T_world_body (4, 4).

        Those that the cell does not know are boxes here.
        """
        assert self._solids is not None
        seen = seen_in({BODIES_SEEN: told}, self._solids.cell)[0]
        boxes = {
            body.name: body.box_m
            for body in seen
            if body.name not in self._solids.names and body.box_m
        }
        for name in self._boxes.keys() - {
            n for n, box in boxes.items() if self._boxes.get(n) == box
        }:
            self._bodies.pop(name).delete()
            self._sent.pop(name, None)
            self._painted.pop(name, None)
        with self._scene:
            for name in boxes.keys() - self._bodies.keys():
                self._bodies[name] = self._scene.box(*boxes[name]).with_name(name).material(MET)
        self._boxes = boxes
        return {body.name: body.T_world for body in seen if body.name in self._bodies}

    def _place(self, poses: dict[str, tuple[float, ...]]) -> None:
        """Tell the page where the bodies are that are not where they were."""
        new = {
            self._bodies[name].id: pose
            for name, pose in poses.items()
            if self._sent.get(name) != pose
        }
        self._sent = poses
        if new:
            ui.run_javascript(f"placed({self._scene.id}, {json.dumps(new)})")

    def _paint(self, pairs: Sequence[tuple[str, str]]) -> None:
        assert self._solids is not None
        red = {name for pair in pairs for name in pair}
        chosen = {
            name for name in self._bodies if self.look.step and names_any([name], [self.look.step])
        }
        painted = dict.fromkeys(chosen, CHOSEN) | dict.fromkeys(red, RED)
        for name in painted.keys() | self._painted.keys():
            if painted.get(name) != self._painted.get(name):
                usual = self._solids.colours.get(name, MET)
                self._bodies[name].material(painted.get(name, usual))
        self._painted = painted
        said = "; ".join(f"{body} touches {touched}" for body, touched in pairs)
        self._touching.set_text(f"✗ {said}" if said else "✓ nothing touches")

    def _draw_path(self, taken: TakenStep | None) -> None:
        """The way of the tool in the step that goes on, as dots."""
        number = taken.number if taken else 0
        if number == self._path_of or self._solids is None:
            return
        self._path_of = number
        points = tool_path(self._solids.resting, taken).tolist() if taken else []
        self._path.set_points(points, [[0.12, 0.44, 0.71]] * len(points))


def _motion_text(last: TakenStep | None, share: float, looking: bool) -> str:
    if looking:
        return "looking for the motions of the steps ..."
    if last is None:
        return "no step has moved an arm yet"
    if isinstance(last.motion, Unmoved):
        return f"{last.motion.operator}: no motion is shown, because {last.motion.reason}"
    return f"{last.motion.operator}: {round(100 * share)} %" if share < 1.0 else "the arm rests"


def body_scene(
    solids: CellBodies, clicks: Sequence[str] = ()
) -> tuple[ui.scene, dict[str, Object3D]]:
    """The bodies of a cell in a scene; each has its name."""
    camera = ui.scene.perspective_camera(fov=45)
    scene = ui.scene(
        camera=camera,
        width=900,
        height=480,
        grid=False,
        background_color="#dfe3ea",
        fps=30,
        click_events=list(clicks),
    )
    scene.classes("w-full").style("height: calc(100vh - 260px); min-height: 320px").props(
        'data-testid="scene"'
    )
    with scene:
        bodies: dict[str, Object3D] = {
            name: scene.stl(f"/solids/{solids.key}/{number}")
            .with_name(name)
            .material(solids.colours[name])
            for number, name in enumerate(solids.names)
        }
    return scene, bodies


def turn_camera(scene: ui.scene, solids: CellBodies, side: str, seconds: float) -> None:
    """Look at everything from a side."""
    middle, reach = solids.extent
    away = [
        at + 1.7 * reach * part for at, part in zip(middle.tolist(), VIEW_SIDES[side], strict=True)
    ]
    scene.move_camera(*[*away, *middle.tolist(), *VIEW_UP, seconds])
