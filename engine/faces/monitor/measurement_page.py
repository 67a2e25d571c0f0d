"""The page that enters measurements: points are picked on the part or typed, and saved."""

import asyncio
import json
from typing import Any

from nicegui import background_tasks, events, ui

from cellwright.engine.faces.monitor.cell3d import VIEW_SIDES, body_scene, turn_camera
from cellwright.engine.faces.monitor.measurement_sheets import (
    MeasuredPart,
    point_verdict,
    written_point,
)
from cellwright.engine.faces.monitor.page_frame import page_head, page_heading
from cellwright.engine.faces.monitor.shared_state import SharedState
from cellwright.engine.formats.interop.inspection_files import as_qif
from cellwright.engine.stages.geometry.shapes.snapping import SnapTo
from cellwright.kb.diagnostics import InvalidInput

SIZE_FIELDS = ("nominal", "tolerance", "bore")  # millimetres, may be empty
POINT_COLUMNS = ("name", "kind", "x", "y", "z", *SIZE_FIELDS, "tool")
NUMBER_CELL = """<q-td :props="props"><q-input dense borderless type="number" v-model.number="props.row[props.col.name]"
  :aria-label="props.col.name + ' of ' + props.row.name" input-style="width: 5em"
  :readonly="READ_ONLY"
  @change="() => $parent.$emit('edited', props.row)" /></q-td>"""
ANY_TOOL = "any"  # tool
# colours, and how large a point is shown, of everything
CHOSEN, WRITTEN, SIZE = "#d02090", "#1f6fb5", 0.012


class MeasuringPage:
    """The measurements of one problem file.

    Raises `InvalidInput` for a file that cannot be read or is not in the folder.
    """

    def __init__(self, shared: SharedState, name: str) -> None:
        self.shared, self.name = shared, name
        self.path = shared.sheets.path(name)
        self.part = MeasuredPart(self.path)
        self._scene: ui.scene
        page_head(shared)
        page_heading(name)
        with ui.row().classes("w-full no-wrap items-start"):
            with ui.column().classes("col-7"):
                self._model()
            with ui.column().classes("col-5 gap-1"):
                self._form()
                self._list()
        self._refill()

    def _model(self) -> None:
        """The part in its cell."""
        solids = self.part.solids
        with ui.row().classes("items-center gap-2"):
            for side in VIEW_SIDES:
                ui.button(
                    side, on_click=lambda _, side=side: turn_camera(self._scene, solids, side, 0.5)
                ).props("dense no-caps outline")
            words = {SnapTo.FACE: "on a face", SnapTo.EDGE: "on an edge", SnapTo.HOLE: "in a hole"}
            self._snap = ui.radio({k.value: said for k, said in words.items()}, value="face")
            self._snap.props('inline dense data-testid="snap"')
        self._scene, bodies = body_scene(solids, clicks=["dblclick"])
        self._scene.on_click(self._picked)
        poses = solids.poses(solids.resting.home)
        placed = {bodies[name].id: tuple(pose.ravel().round(6)) for name, pose in poses.items()}
        ui.timer(
            0.2,
            lambda: ui.run_javascript(f"placed({self._scene.id}, {json.dumps(placed)})"),
            once=True,
        )
        turn_camera(self._scene, solids, "corner", 0.0)
        ui.label(
            "A double click picks a point. Coordinates are in millimetres, in the frame of the "
            "part."
        )
        with self._scene:
            self._marks = self._scene.group()
            self._cross = (
                self._scene.sphere(SIZE * self.part.solids.extent[1] / 3)
                .material(CHOSEN)
                .visible(False)
            )

    def _form(self) -> None:
        """What is asked of one point."""
        with ui.row().classes("items-center gap-2"):
            self._name = ui.input("name", value=self.part.free_name()).props(
                'dense data-testid="name"'
            )
            self._kind = ui.select(self.part.kinds, value=self.part.kinds[0], label="measure")
            self._kind.props('dense options-dense data-testid="kind"').classes("w-32")
            self._tool = ui.select([ANY_TOOL, *self.part.tools], value=ANY_TOOL, label="by tool")
            self._tool.props('dense options-dense data-testid="tool"').classes("w-32")
            self._tool.set_visibility(bool(self.part.tools))
        self._at = self._numbers("x", "y", "z")
        self._normal = self._numbers("nx", "ny", "nz", values=(0.0, 0.0, 1.0))
        self._sizes = self._numbers(*SIZE_FIELDS, values=(None, None, None))
        for field in (*self._at.values(), *self._normal.values(), *self._sizes.values()):
            field.on("change", self._look)
        for chosen in (self._kind, self._tool):
            chosen.on_value_change(self._look)
        self._verdict = ui.label("").props('data-testid="verdict" role="status"')
        with ui.row().classes("gap-2"):
            self._button("Look", "look", self._look)
            self._button("Add", "add", lambda: self._send("added", [self._point()]))
            self._button("Change chosen", "change", self._change)
            self._button("Remove chosen", "remove", self._remove)
            self._button("Undo", "undo", lambda: self._send("undo", []))
            self._button("Save as QIF", "qif", self._as_qif)

    def _button(self, said: str, name: str, does: Any) -> None:
        if name in ("look", "qif") or not self.shared.read_only:
            ui.button(said, on_click=does).props(f'dense no-caps data-testid="{name}"')

    def _numbers(
        self, *names: str, values: tuple[float | None, ...] = (0.0, 0.0, 0.0)
    ) -> dict[str, ui.number]:
        with ui.row().classes("gap-2 no-wrap"):
            return {
                name: ui.number(name, value=value)
                .props(f'dense data-testid="{name}"')
                .classes("w-28")
                for name, value in zip(names, values, strict=True)
            }

    def _list(self) -> None:
        columns = [
            {"name": column, "label": column, "field": column, "align": "left"}
            for column in POINT_COLUMNS
        ]
        self._table = ui.table(columns=columns, rows=[], row_key="name", selection="multiple")
        self._table.props(
            'dense flat data-testid="points" no-data-label="no measurement has a position yet"'
        )
        self._table.classes("w-full").style("max-height: 40vh")
        for column in ("x", "y", "z", *SIZE_FIELDS):
            self._table.add_slot(
                f"body-cell-{column}",
                NUMBER_CELL.replace("READ_ONLY", str(self.shared.read_only).lower()),
            )
        self._table.on("edited", lambda event: self._edited(event.args))

    def _refill(self) -> None:
        """Show the measurements that the file has now."""
        points = [written_point(measured_point) for measured_point in self.part.points]
        self._table.rows = [
            {**row_point, **dict(zip("xyz", row_point["at"], strict=True))} for row_point in points
        ]
        self._table.selected = []
        for mark in [
            drawn for drawn in self._scene.objects.values() if drawn.parent is self._marks
        ]:
            mark.delete()
        with self._scene, self._marks:
            for point in self.part.points:
                mark = (
                    self._scene.sphere(SIZE * self.part.solids.extent[1] / 3)
                    .material(WRITTEN)
                    .with_name(point.name)
                )
                mark.move(*self.part.in_world(point.position))

    async def _picked(self, event: events.SceneClickEventArguments) -> None:
        """A point of the model was picked: snap it, and tell whether it can be measured."""
        hits = [hit for hit in event.hits if hit.object_name in self.part.solids.names]
        if not hits or hits[0].object_name not in self.part.bodies:
            ui.notify("this is not a face of the part", type="warning")
            return
        at = (hits[0].x, hits[0].y, hits[0].z)
        snapped_at = self.part.picked(hits[0].object_name, at, SnapTo(str(self._snap.value)))
        if snapped_at is None:
            ui.notify(f"there is no {self._snap.value} within 100 mm of this point", type="warning")
            return
        for field, value in zip(self._at.values(), snapped_at.point.tolist(), strict=True):
            field.set_value(round(1000 * value, 3))
        for field, value in zip(self._normal.values(), snapped_at.normal.tolist(), strict=True):
            field.set_value(round(value, 6) + 0.0)
        if snapped_at.bore_m is not None:
            self._sizes["bore"].set_value(round(1000 * snapped_at.bore_m, 3))
        self._look()

    def _point(self) -> dict[str, Any]:
        sizes = {key: field.value for key, field in self._sizes.items() if field.value is not None}
        return {
            "name": str(self._name.value or ""),
            "kind": str(self._kind.value),
            "at": [number_field.value for number_field in self._at.values()],
            "normal": [number_field.value for number_field in self._normal.values()],
            "tool": "" if self._tool.value == ANY_TOOL else str(self._tool.value),
            **sizes,
        }

    def _look(self) -> None:
        """Have the point judged as it is now; of several that wait, only the last one is."""
        background_tasks.create_lazy(self._judge(), name=f"judged {id(self)}")

    async def _judge(self) -> None:
        """Tell whether the point can be measured, and if not, why."""
        point = self._point()
        self._verdict.set_text("looking for a way to it ...")
        if None not in point["at"]:
            self._cross.move(
                *self.part.in_world([coordinate / 1000 for coordinate in point["at"]])
            ).visible(True)
        asked = self.shared.workers.submit(_judge_point, str(self.path), point)
        reached, said = await asyncio.wrap_future(asked)
        self._verdict.set_text(
            f"✓ can be measured {said}" if reached else f"✗ cannot be measured: {said}"
        )
        self._verdict.classes(
            add="text-positive" if reached else "text-negative",
            remove="text-negative" if reached else "text-positive",
        )

    async def _edited(self, row: dict[str, Any]) -> None:
        """Write what was changed in a row of the table; a size that was emptied is taken away."""
        sizes = {key: row[key] for key in SIZE_FIELDS if row.get(key) not in (None, "")}
        kept = {key: row[key] for key in ("name", "kind", "normal", "tool") if key in row}
        await self._send("replaced", [{**kept, "at": [row["x"], row["y"], row["z"]], **sizes}])

    async def _change(self) -> None:
        """Give all chosen measurements the kind, the tool, and those sizes that are filled in."""
        given = {key: field.value for key, field in self._sizes.items() if field.value is not None}
        chosen = {row["name"] for row in self._table.selected}
        points = [
            written_point(part_point)
            for part_point in self.part.points
            if part_point.name in chosen
        ]
        given |= {"kind": str(self._kind.value), "tool": self._point()["tool"]}
        await self._send("replaced", [{**row_point, **given} for row_point in points])

    async def _remove(self) -> None:
        await self._send("removed", [row["name"] for row in self._table.selected])

    def _as_qif(self) -> None:
        """Give the browser the measurements as a QIF document, to be saved where the person
        wants it.
        """
        text, _, told = as_qif(self.part.problem)
        ui.download(text.encode(), f"{self.path.stem}.qif", "application/xml")
        for remark in told:
            ui.notify(remark.message, type="warning")

    async def _send(self, how: str, points: list[Any]) -> None:
        """Ask for a change as the page does, with its token and a key; then show what the file
        has.
        """
        asked = json.dumps({"file": self.name, "how": how, "points": points})
        await ui.run_javascript(f"return send('/measurements', {asked})", timeout=90.0)
        self.part = MeasuredPart(self.path)
        self._name.set_value(self.part.free_name())
        self._refill()


def _judge_point(path: str, point: dict[str, Any]) -> tuple[bool, str]:
    """The verdict on a point, in a process of its own; a point that cannot be read has none."""
    try:
        return point_verdict(path, point)
    except InvalidInput as refused:
        return False, refused.diagnostics[0].message


class ChoosingPage:
    """The problem files of the folder, and ways to make one more."""

    def __init__(self, shared: SharedState) -> None:
        page_head(shared)
        page_heading("Measurements", "measurements")
        files = shared.sheets.files(".yaml")
        ui.label(
            f"Problem files in {shared.sheets.folder}"
            if files
            else f"no problem file in {shared.sheets.folder}"
        )
        for file in files:
            ui.link(file, f"/measure/{file}")
        if shared.read_only:
            return
        with ui.row().classes("items-center"):
            name = ui.input("name").props('dense data-testid="new-name"')
            domain = ui.input("domain", value="bulkhead").props('dense data-testid="new-domain"')
            ui.button(
                "New problem",
                on_click=lambda: self._send("new", str(name.value), str(domain.value)),
            ).props('dense no-caps data-testid="new"')
        for source in shared.sheets.files(".qif", ".csv"):
            ui.button(
                f"Import {source}",
                on_click=lambda _, source=source: self._send("import", source, str(domain.value)),
            ).props('dense no-caps outline data-testid="import"')

    async def _send(self, how: str, name: str, domain: str) -> None:
        asked = json.dumps({"file": name, "how": how, "domain": domain})
        told = await ui.run_javascript(f"return send('/measurements', {asked})", timeout=60.0)
        if told and told.get("done"):
            ui.navigate.reload()
