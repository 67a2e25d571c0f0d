"""Inspections: measurement points, the tools and tours for them, and verdicts on measured
values.
"""

from typing import TYPE_CHECKING

from cellwright.kb.doorways import open_doorway

if TYPE_CHECKING:
    from cellwright.engine.pipelines.inspection.arm_capabilities import (
        partition_for_arms as partition_for_arms,
    )
    from cellwright.engine.pipelines.inspection.feature_verdicts import (
        assess_features as assess_features,
    )
    from cellwright.engine.pipelines.inspection.feature_verdicts import survey_run as survey_run
    from cellwright.engine.pipelines.inspection.measurement_points import (
        points_of_problem as points_of_problem,
    )
    from cellwright.engine.pipelines.inspection.measurement_points import with_places as with_places
    from cellwright.engine.pipelines.inspection.part_alignment import (
        aligned_within_m as aligned_within_m,
    )
    from cellwright.engine.pipelines.inspection.part_alignment import (
        alignment_asked as alignment_asked,
    )
    from cellwright.engine.pipelines.inspection.part_alignment import datum_points as datum_points
    from cellwright.engine.pipelines.inspection.part_alignment import (
        datums_of_points as datums_of_points,
    )
    from cellwright.engine.pipelines.inspection.part_alignment import (
        displace_problem as displace_problem,
    )
    from cellwright.engine.pipelines.inspection.part_alignment import (
        known_profiles as known_profiles,
    )
    from cellwright.engine.pipelines.inspection.part_alignment import (
        measured_datums as measured_datums,
    )
    from cellwright.engine.pipelines.inspection.part_alignment import once_m as once_m
    from cellwright.engine.pipelines.inspection.tour_demands import as_facts as as_facts
    from cellwright.engine.pipelines.inspection.tour_demands import of_options as of_options
    from cellwright.engine.pipelines.inspection.tour_demands import (
        require_known_visits as require_known_visits,
    )
    from cellwright.engine.pipelines.inspection.tour_progress import FOUND_BAD as FOUND_BAD
    from cellwright.engine.pipelines.inspection.tour_progress import SequenceNews as SequenceNews
    from cellwright.engine.pipelines.inspection.travel_costs import time_between as time_between
else:
    __getattr__ = open_doorway(
        __name__,
        {
            ".arm_capabilities": ("partition_for_arms",),
            ".feature_verdicts": (
                "assess_features",
                "survey_run",
            ),
            ".measurement_points": (
                "points_of_problem",
                "with_places",
            ),
            ".part_alignment": (
                "aligned_within_m",
                "alignment_asked",
                "datum_points",
                "datums_of_points",
                "displace_problem",
                "known_profiles",
                "measured_datums",
                "once_m",
            ),
            ".tour_demands": (
                "as_facts",
                "of_options",
                "require_known_visits",
            ),
            ".tour_progress": (
                "FOUND_BAD",
                "SequenceNews",
            ),
            ".travel_costs": ("time_between",),
        },
    )
