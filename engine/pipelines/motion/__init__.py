"""Motions of arms: paths and times for every step of a plan, poses for measurements, and images."""

from typing import TYPE_CHECKING

from cellwright.kb.doorways import open_doorway

if TYPE_CHECKING:
    from cellwright.engine.pipelines.motion.arm_motion import MotionSite as MotionSite
    from cellwright.engine.pipelines.motion.arm_motion import MotionWish as MotionWish
    from cellwright.engine.pipelines.motion.arm_motion import plan_named_motion as plan_named_motion
    from cellwright.engine.pipelines.motion.image_dimensions import (
        DimensionRequest as DimensionRequest,
    )
    from cellwright.engine.pipelines.motion.image_dimensions import (
        dimensions_in_image as dimensions_in_image,
    )
    from cellwright.engine.pipelines.motion.image_dimensions import relate_shapes as relate_shapes
    from cellwright.engine.pipelines.motion.measured_surface import ImageRequest as ImageRequest
    from cellwright.engine.pipelines.motion.measured_surface import ranging_of as ranging_of
    from cellwright.engine.pipelines.motion.measurement_poses import kept_poses as kept_poses
    from cellwright.engine.pipelines.motion.motion_tours import driven_tours as driven_tours
    from cellwright.engine.pipelines.motion.motion_tours import posed_tours as posed_tours
    from cellwright.engine.pipelines.motion.moving_plan import known_ways as known_ways
    from cellwright.engine.pipelines.motion.moving_plan import plan_with_poses as plan_with_poses
    from cellwright.engine.pipelines.motion.plan_walk import PlanWalk as PlanWalk
    from cellwright.engine.pipelines.motion.problem_sets import (
        draw_motion_problems as draw_motion_problems,
    )
    from cellwright.engine.pipelines.motion.problem_sets import problem_entries as problem_entries
    from cellwright.engine.pipelines.motion.problem_sets import problems_in as problems_in
    from cellwright.engine.pipelines.motion.problem_sets import replayed_set as replayed_set
    from cellwright.engine.pipelines.motion.problem_sets import table_by as table_by
    from cellwright.engine.pipelines.motion.seen_bodies import seen_in as seen_in
    from cellwright.engine.pipelines.motion.seen_bodies import with_seen as with_seen
    from cellwright.engine.pipelines.motion.step_film import shots_of_film as shots_of_film
    from cellwright.engine.pipelines.motion.step_film import takes_of_plan as takes_of_plan
    from cellwright.engine.pipelines.motion.step_film import takes_of_run as takes_of_run
    from cellwright.engine.pipelines.motion.step_film import thin_shots as thin_shots
else:
    __getattr__ = open_doorway(
        __name__,
        {
            ".arm_motion": (
                "MotionSite",
                "MotionWish",
                "plan_named_motion",
            ),
            ".image_dimensions": (
                "DimensionRequest",
                "dimensions_in_image",
                "relate_shapes",
            ),
            ".measured_surface": (
                "ImageRequest",
                "ranging_of",
            ),
            ".measurement_poses": ("kept_poses",),
            ".motion_tours": (
                "driven_tours",
                "posed_tours",
            ),
            ".moving_plan": (
                "known_ways",
                "plan_with_poses",
            ),
            ".plan_walk": ("PlanWalk",),
            ".problem_sets": (
                "draw_motion_problems",
                "problem_entries",
                "problems_in",
                "replayed_set",
                "table_by",
            ),
            ".seen_bodies": (
                "seen_in",
                "with_seen",
            ),
            ".step_film": (
                "shots_of_film",
                "takes_of_plan",
                "takes_of_run",
                "thin_shots",
            ),
        },
    )
