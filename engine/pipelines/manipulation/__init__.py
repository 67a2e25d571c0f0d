"""Manipulation: PLACE part ON part and assemblies, planned (Handey) and carried out in physics."""

from typing import TYPE_CHECKING

from cellwright.kb.doorways import open_doorway

if TYPE_CHECKING:
    from cellwright.engine.pipelines.manipulation.arm_monitoring import (
        begin_watching as begin_watching,
    )
    from cellwright.engine.pipelines.manipulation.arm_monitoring import watch_events as watch_events
    from cellwright.engine.pipelines.manipulation.assembly_execution import PartShift as PartShift
    from cellwright.engine.pipelines.manipulation.assembly_execution import (
        execute_assembly as execute_assembly,
    )
    from cellwright.engine.pipelines.manipulation.assembly_execution import (
        execute_carries as execute_carries,
    )
    from cellwright.engine.pipelines.manipulation.assembly_order import Built as Built
    from cellwright.engine.pipelines.manipulation.assembly_order import (
        assemble_scene as assemble_scene,
    )
    from cellwright.engine.pipelines.manipulation.camera_calibration import (
        calibrate_camera as calibrate_camera,
    )
    from cellwright.engine.pipelines.manipulation.camera_calibration import (
        calibrate_range as calibrate_range,
    )
    from cellwright.engine.pipelines.manipulation.camera_calibration import (
        made_readings as made_readings,
    )
    from cellwright.engine.pipelines.manipulation.camera_calibration import (
        plate_images as plate_images,
    )
    from cellwright.engine.pipelines.manipulation.camera_calibration import (
        scene_with_camera as scene_with_camera,
    )
    from cellwright.engine.pipelines.manipulation.camera_calibration import with_range as with_range
    from cellwright.engine.pipelines.manipulation.camera_cell import errors_of as errors_of
    from cellwright.engine.pipelines.manipulation.camera_optics import CameraErrors as CameraErrors
    from cellwright.engine.pipelines.manipulation.camera_optics import CameraOptics as CameraOptics
    from cellwright.engine.pipelines.manipulation.carry_paths import plane_of as plane_of
    from cellwright.engine.pipelines.manipulation.carry_paths import way_in as way_in
    from cellwright.engine.pipelines.manipulation.place_answers import NotPlaced as NotPlaced
    from cellwright.engine.pipelines.manipulation.place_answers import Placed as Placed
    from cellwright.engine.pipelines.manipulation.place_operation import (
        bring_to_relation as bring_to_relation,
    )
    from cellwright.engine.pipelines.manipulation.place_operation import look_again as look_again
    from cellwright.engine.pipelines.manipulation.place_operation import place_part as place_part
    from cellwright.engine.pipelines.manipulation.placement_views import film_shots as film_shots
    from cellwright.engine.pipelines.manipulation.placement_views import (
        regrasp_graph as regrasp_graph,
    )
    from cellwright.engine.pipelines.manipulation.scene_camera import camera_of as camera_of
    from cellwright.engine.pipelines.manipulation.scene_camera import camera_pose as camera_pose
    from cellwright.engine.pipelines.manipulation.scene_camera import recognised_in as recognised_in
    from cellwright.engine.pipelines.manipulation.scene_camera import seen_edges as seen_edges
    from cellwright.engine.pipelines.manipulation.workspace import AssemblySite as AssemblySite
    from cellwright.engine.pipelines.manipulation.workspace import (
        HandApproachKind as HandApproachKind,
    )
    from cellwright.engine.pipelines.manipulation.workspace import MotionManner as MotionManner
else:
    __getattr__ = open_doorway(
        __name__,
        {
            ".arm_monitoring": (
                "begin_watching",
                "watch_events",
            ),
            ".assembly_execution": (
                "PartShift",
                "execute_assembly",
                "execute_carries",
            ),
            ".assembly_order": (
                "Built",
                "assemble_scene",
            ),
            ".camera_calibration": (
                "calibrate_camera",
                "calibrate_range",
                "made_readings",
                "plate_images",
                "scene_with_camera",
                "with_range",
            ),
            ".camera_cell": ("errors_of",),
            ".camera_optics": (
                "CameraErrors",
                "CameraOptics",
            ),
            ".carry_paths": (
                "plane_of",
                "way_in",
            ),
            ".place_answers": (
                "NotPlaced",
                "Placed",
            ),
            ".place_operation": (
                "bring_to_relation",
                "look_again",
                "place_part",
            ),
            ".placement_views": (
                "film_shots",
                "regrasp_graph",
            ),
            ".scene_camera": (
                "camera_of",
                "camera_pose",
                "recognised_in",
                "seen_edges",
            ),
            ".workspace": (
                "AssemblySite",
                "HandApproachKind",
                "MotionManner",
            ),
        },
    )
