"""Answers for people and programs: text, JSON, DOT, SVG."""

from typing import TYPE_CHECKING

from cellwright.kb.doorways import open_doorway

if TYPE_CHECKING:
    from cellwright.engine.formats.report.cells.assembly_report import (
        assembly_content as assembly_content,
    )
    from cellwright.engine.formats.report.cells.assembly_report import (
        assembly_status as assembly_status,
    )
    from cellwright.engine.formats.report.cells.assembly_report import (
        assembly_text as assembly_text,
    )
    from cellwright.engine.formats.report.cells.assembly_report import (
        followed_content as followed_content,
    )
    from cellwright.engine.formats.report.cells.assembly_report import (
        followed_text as followed_text,
    )
    from cellwright.engine.formats.report.cells.assembly_report import (
        portion_content as portion_content,
    )
    from cellwright.engine.formats.report.cells.assembly_report import (
        portion_status as portion_status,
    )
    from cellwright.engine.formats.report.cells.assembly_report import portion_text as portion_text
    from cellwright.engine.formats.report.cells.calibration_report import (
        camera_content as camera_content,
    )
    from cellwright.engine.formats.report.cells.calibration_report import camera_text as camera_text
    from cellwright.engine.formats.report.cells.calibration_report import (
        range_content as range_content,
    )
    from cellwright.engine.formats.report.cells.calibration_report import range_text as range_text
    from cellwright.engine.formats.report.cells.device_report import device_entry as device_entry
    from cellwright.engine.formats.report.cells.device_report import device_page as device_page
    from cellwright.engine.formats.report.cells.device_report import device_table as device_table
    from cellwright.engine.formats.report.cells.motion_pictures import as_pngs as as_pngs
    from cellwright.engine.formats.report.cells.motion_pictures import film_gltf as film_gltf
    from cellwright.engine.formats.report.cells.motion_pictures import motion_gltf as motion_gltf
    from cellwright.engine.formats.report.cells.motion_pictures import motion_png as motion_png
    from cellwright.engine.formats.report.cells.motion_pictures import motion_svg as motion_svg
    from cellwright.engine.formats.report.cells.motion_report import (
        motion_content as motion_content,
    )
    from cellwright.engine.formats.report.cells.motion_report import motion_status as motion_status
    from cellwright.engine.formats.report.cells.motion_report import motion_text as motion_text
    from cellwright.engine.formats.report.cells.motion_tables import replay_entry as replay_entry
    from cellwright.engine.formats.report.cells.motion_tables import replay_table as replay_table
    from cellwright.engine.formats.report.cells.motion_tables import travel_entry as travel_entry
    from cellwright.engine.formats.report.cells.motion_tables import travel_table as travel_table
    from cellwright.engine.formats.report.cells.net_report import brings_entry as brings_entry
    from cellwright.engine.formats.report.cells.net_report import brought_text as brought_text
    from cellwright.engine.formats.report.cells.net_report import net_content as net_content
    from cellwright.engine.formats.report.cells.net_report import net_text as net_text
    from cellwright.engine.formats.report.cells.net_report import place_templates as place_templates
    from cellwright.engine.formats.report.cells.physics_report import (
        carried_content as carried_content,
    )
    from cellwright.engine.formats.report.cells.physics_report import carried_text as carried_text
    from cellwright.engine.formats.report.cells.physics_report import (
        physics_content as physics_content,
    )
    from cellwright.engine.formats.report.cells.physics_report import physics_text as physics_text
    from cellwright.engine.formats.report.cells.placing_pictures import depth_png as depth_png
    from cellwright.engine.formats.report.cells.placing_pictures import (
        grasp_plane_svg as grasp_plane_svg,
    )
    from cellwright.engine.formats.report.cells.placing_pictures import (
        placements_svg as placements_svg,
    )
    from cellwright.engine.formats.report.cells.placing_report import (
        placing_content as placing_content,
    )
    from cellwright.engine.formats.report.cells.placing_report import (
        placing_status as placing_status,
    )
    from cellwright.engine.formats.report.cells.placing_report import placing_text as placing_text
    from cellwright.engine.formats.report.cells.placing_report import (
        second_look_text as second_look_text,
    )
    from cellwright.engine.formats.report.diagnostic_messages import (
        diagnostics_summary as diagnostics_summary,
    )
    from cellwright.engine.formats.report.diagnostic_messages import (
        diagnostics_text as diagnostics_text,
    )
    from cellwright.engine.formats.report.drawing.dot_graphs import net_dot as net_dot
    from cellwright.engine.formats.report.drawing.dot_graphs import plan_dot as plan_dot
    from cellwright.engine.formats.report.drawing.net_svg import draw_net as draw_net
    from cellwright.engine.formats.report.drawing.plan_svg import draw_plan as draw_plan
    from cellwright.engine.formats.report.drawing.tour_svg import draw_tour as draw_tour
    from cellwright.engine.formats.report.json_answers import json_envelope as json_envelope
    from cellwright.engine.formats.report.json_answers import outcome_entry as outcome_entry
    from cellwright.engine.formats.report.json_answers import outcome_status as outcome_status
    from cellwright.engine.formats.report.measurements.fit_report import (
        alignment_entry as alignment_entry,
    )
    from cellwright.engine.formats.report.measurements.fit_report import (
        alignment_text as alignment_text,
    )
    from cellwright.engine.formats.report.measurements.fit_report import fit_entry as fit_entry
    from cellwright.engine.formats.report.measurements.fit_report import fits_text as fits_text
    from cellwright.engine.formats.report.measurements.fit_report import (
        related_entries as related_entries,
    )
    from cellwright.engine.formats.report.measurements.range_image_report import (
        dimensions_content as dimensions_content,
    )
    from cellwright.engine.formats.report.measurements.range_image_report import (
        dimensions_text as dimensions_text,
    )
    from cellwright.engine.formats.report.measurements.range_image_report import (
        range_image_png as range_image_png,
    )
    from cellwright.engine.formats.report.measurements.range_image_report import (
        recognition_content as recognition_content,
    )
    from cellwright.engine.formats.report.measurements.range_image_report import (
        recognition_text as recognition_text,
    )
    from cellwright.engine.formats.report.measurements.range_image_report import (
        surface_content as surface_content,
    )
    from cellwright.engine.formats.report.measurements.range_image_report import (
        surface_text as surface_text,
    )
    from cellwright.engine.formats.report.measurements.sequence_progress import (
        next_entry as next_entry,
    )
    from cellwright.engine.formats.report.measurements.sequence_progress import (
        next_text as next_text,
    )
    from cellwright.engine.formats.report.measurements.sequence_progress import (
        sequence_entry as sequence_entry,
    )
    from cellwright.engine.formats.report.measurements.sequence_progress import (
        sequence_text as sequence_text,
    )
    from cellwright.engine.formats.report.measurements.survey_report import (
        survey_entry as survey_entry,
    )
    from cellwright.engine.formats.report.measurements.survey_report import (
        survey_html as survey_html,
    )
    from cellwright.engine.formats.report.measurements.survey_report import (
        survey_text as survey_text,
    )
    from cellwright.engine.formats.report.measurements.tool_groups import (
        driven_entry as driven_entry,
    )
    from cellwright.engine.formats.report.measurements.tool_groups import driven_text as driven_text
    from cellwright.engine.formats.report.measurements.tool_groups import posed_entry as posed_entry
    from cellwright.engine.formats.report.measurements.tool_groups import posed_text as posed_text
    from cellwright.engine.formats.report.measurements.tool_groups import (
        tool_groups_entry as tool_groups_entry,
    )
    from cellwright.engine.formats.report.measurements.tool_groups import (
        tool_groups_text as tool_groups_text,
    )
    from cellwright.engine.formats.report.measurements.tour_report import (
        shares_entry as shares_entry,
    )
    from cellwright.engine.formats.report.measurements.tour_report import shares_text as shares_text
    from cellwright.engine.formats.report.measurements.tour_report import (
        visits_tour_content as visits_tour_content,
    )
    from cellwright.engine.formats.report.measurements.tour_report import (
        visits_tour_text as visits_tour_text,
    )
    from cellwright.engine.formats.report.plans.explanation_report import (
        explanation_entry as explanation_entry,
    )
    from cellwright.engine.formats.report.plans.explanation_report import (
        explanation_text as explanation_text,
    )
    from cellwright.engine.formats.report.plans.explanation_report import step_entry as step_entry
    from cellwright.engine.formats.report.plans.explanation_report import step_reason as step_reason
    from cellwright.engine.formats.report.plans.library_report import (
        library_figures as library_figures,
    )
    from cellwright.engine.formats.report.plans.library_report import library_table as library_table
    from cellwright.engine.formats.report.plans.library_report import macrop_text as macrop_text
    from cellwright.engine.formats.report.plans.library_report import (
        preparation_content as preparation_content,
    )
    from cellwright.engine.formats.report.plans.library_report import (
        preparation_text as preparation_text,
    )
    from cellwright.engine.formats.report.plans.plan_answer import PlanAnswer as PlanAnswer
    from cellwright.engine.formats.report.plans.plan_answer import (
        library_warnings as library_warnings,
    )
    from cellwright.engine.formats.report.plans.plan_answer import (
        plan_answer_content as plan_answer_content,
    )
    from cellwright.engine.formats.report.plans.plan_answer import (
        plan_answer_text as plan_answer_text,
    )
    from cellwright.engine.formats.report.plans.schedule_report import (
        ScheduleAnswer as ScheduleAnswer,
    )
    from cellwright.engine.formats.report.plans.schedule_report import of_plan as of_plan
    from cellwright.engine.formats.report.plans.schedule_report import (
        schedule_content as schedule_content,
    )
    from cellwright.engine.formats.report.plans.schedule_report import schedule_svg as schedule_svg
    from cellwright.engine.formats.report.plans.schedule_report import (
        schedule_text as schedule_text,
    )
    from cellwright.engine.formats.report.runs.diagnosis_report import advice_entry as advice_entry
    from cellwright.engine.formats.report.runs.diagnosis_report import (
        advice_reasons as advice_reasons,
    )
    from cellwright.engine.formats.report.runs.diagnosis_report import belief_table as belief_table
    from cellwright.engine.formats.report.runs.diagnosis_report import case_entry as case_entry
    from cellwright.engine.formats.report.runs.diagnosis_report import case_text as case_text
    from cellwright.engine.formats.report.runs.diagnosis_report import cost_text as cost_text
    from cellwright.engine.formats.report.runs.diagnosis_report import (
        decision_tree_svg as decision_tree_svg,
    )
    from cellwright.engine.formats.report.runs.diagnosis_report import (
        decision_tree_text as decision_tree_text,
    )
    from cellwright.engine.formats.report.runs.diagnosis_report import tree_entry as tree_entry
    from cellwright.engine.formats.report.runs.recovery_report import (
        recovery_entry as recovery_entry,
    )
    from cellwright.engine.formats.report.runs.recovery_report import recovery_text as recovery_text
    from cellwright.engine.formats.report.runs.recovery_report import (
        revision_entry as revision_entry,
    )
    from cellwright.engine.formats.report.runs.recovery_report import revision_text as revision_text
    from cellwright.engine.formats.report.runs.results_report import results_text as results_text
    from cellwright.engine.formats.report.runs.run_display import RunDisplay as RunDisplay
    from cellwright.engine.formats.report.runs.run_report import ending_entry as ending_entry
    from cellwright.engine.formats.report.runs.run_report import ending_text as ending_text
    from cellwright.engine.formats.report.runs.run_report import narrate_problem as narrate_problem
    from cellwright.engine.formats.report.runs.run_report import narrate_record as narrate_record
    from cellwright.engine.formats.report.text_tables import TextTable as TextTable
else:
    __getattr__ = open_doorway(
        __name__,
        {
            ".cells.assembly_report": (
                "assembly_content",
                "assembly_status",
                "assembly_text",
                "followed_content",
                "followed_text",
                "portion_content",
                "portion_status",
                "portion_text",
            ),
            ".cells.calibration_report": (
                "camera_content",
                "camera_text",
                "range_content",
                "range_text",
            ),
            ".cells.device_report": (
                "device_entry",
                "device_page",
                "device_table",
            ),
            ".cells.motion_pictures": (
                "as_pngs",
                "film_gltf",
                "motion_gltf",
                "motion_png",
                "motion_svg",
            ),
            ".cells.motion_report": (
                "motion_content",
                "motion_status",
                "motion_text",
            ),
            ".cells.motion_tables": (
                "replay_entry",
                "replay_table",
                "travel_entry",
                "travel_table",
            ),
            ".cells.net_report": (
                "brings_entry",
                "brought_text",
                "net_content",
                "net_text",
                "place_templates",
            ),
            ".cells.physics_report": (
                "carried_content",
                "carried_text",
                "physics_content",
                "physics_text",
            ),
            ".cells.placing_pictures": (
                "depth_png",
                "grasp_plane_svg",
                "placements_svg",
            ),
            ".cells.placing_report": (
                "placing_content",
                "placing_status",
                "placing_text",
                "second_look_text",
            ),
            ".diagnostic_messages": (
                "diagnostics_summary",
                "diagnostics_text",
            ),
            ".drawing.dot_graphs": (
                "net_dot",
                "plan_dot",
            ),
            ".drawing.net_svg": ("draw_net",),
            ".drawing.plan_svg": ("draw_plan",),
            ".drawing.tour_svg": ("draw_tour",),
            ".json_answers": (
                "json_envelope",
                "outcome_entry",
                "outcome_status",
            ),
            ".measurements.fit_report": (
                "alignment_entry",
                "alignment_text",
                "fit_entry",
                "fits_text",
                "related_entries",
            ),
            ".measurements.range_image_report": (
                "dimensions_content",
                "dimensions_text",
                "range_image_png",
                "recognition_content",
                "recognition_text",
                "surface_content",
                "surface_text",
            ),
            ".measurements.sequence_progress": (
                "next_entry",
                "next_text",
                "sequence_entry",
                "sequence_text",
            ),
            ".measurements.survey_report": (
                "survey_entry",
                "survey_html",
                "survey_text",
            ),
            ".measurements.tool_groups": (
                "driven_entry",
                "driven_text",
                "posed_entry",
                "posed_text",
                "tool_groups_entry",
                "tool_groups_text",
            ),
            ".measurements.tour_report": (
                "shares_entry",
                "shares_text",
                "visits_tour_content",
                "visits_tour_text",
            ),
            ".plans.explanation_report": (
                "explanation_entry",
                "explanation_text",
                "step_entry",
                "step_reason",
            ),
            ".plans.library_report": (
                "library_figures",
                "library_table",
                "macrop_text",
                "preparation_content",
                "preparation_text",
            ),
            ".plans.plan_answer": (
                "PlanAnswer",
                "library_warnings",
                "plan_answer_content",
                "plan_answer_text",
            ),
            ".plans.schedule_report": (
                "ScheduleAnswer",
                "of_plan",
                "schedule_content",
                "schedule_svg",
                "schedule_text",
            ),
            ".runs.diagnosis_report": (
                "advice_entry",
                "advice_reasons",
                "belief_table",
                "case_entry",
                "case_text",
                "cost_text",
                "decision_tree_svg",
                "decision_tree_text",
                "tree_entry",
            ),
            ".runs.recovery_report": (
                "recovery_entry",
                "recovery_text",
                "revision_entry",
                "revision_text",
            ),
            ".runs.results_report": ("results_text",),
            ".runs.run_display": ("RunDisplay",),
            ".runs.run_report": (
                "ending_entry",
                "ending_text",
                "narrate_problem",
                "narrate_record",
            ),
            ".text_tables": ("TextTable",),
        },
    )
