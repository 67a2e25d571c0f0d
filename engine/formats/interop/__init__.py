"""Other formats and systems: PDDL, QIF, TSPLIB, job shops, S-LAB tables and unified-planning."""

from typing import TYPE_CHECKING

from cellwright.kb.doorways import open_doorway

if TYPE_CHECKING:
    from cellwright.engine.formats.interop.behaviour_trees import (
        write_behaviour_tree as write_behaviour_tree,
    )
    from cellwright.engine.formats.interop.calibration_files import read_held as read_held
    from cellwright.engine.formats.interop.calibration_files import read_plates as read_plates
    from cellwright.engine.formats.interop.depth_files import read_cloud as read_cloud
    from cellwright.engine.formats.interop.depth_files import read_depth as read_depth
    from cellwright.engine.formats.interop.inspection_files import as_qif as as_qif
    from cellwright.engine.formats.interop.inspection_files import (
        edit_measurements as edit_measurements,
    )
    from cellwright.engine.formats.interop.inspection_files import import_file as import_file
    from cellwright.engine.formats.interop.inspection_files import (
        inspection_remarks as inspection_remarks,
    )
    from cellwright.engine.formats.interop.measured_alignment import datums_of as datums_of
    from cellwright.engine.formats.interop.measured_alignment import read_results as read_results
    from cellwright.engine.formats.interop.measured_alignment import write_moved as write_moved
    from cellwright.engine.formats.interop.measurement_tables import unit_m as unit_m
    from cellwright.engine.formats.interop.operator_events import read_acts as read_acts
    from cellwright.engine.formats.interop.pddl import read_pddl_task as read_pddl_task
    from cellwright.engine.formats.interop.pddl.competition_plans import read_plan as read_plan
    from cellwright.engine.formats.interop.pddl.competition_plans import write_plan as write_plan
    from cellwright.engine.formats.interop.pddl.durative import has_times as has_times
    from cellwright.engine.formats.interop.pddl.export import export_problem as export_problem
    from cellwright.engine.formats.interop.pddl.export import (
        read_exported_plan as read_exported_plan,
    )
    from cellwright.engine.formats.interop.pddl.export import write_pddl_files as write_pddl_files
    from cellwright.engine.formats.interop.pnml import write_contact_net as write_contact_net
    from cellwright.engine.formats.interop.range_files import read_ranges as read_ranges
    from cellwright.engine.formats.interop.range_files import write_ranges as write_ranges
    from cellwright.engine.formats.interop.results import ResultForm as ResultForm
    from cellwright.engine.formats.interop.results import write_results as write_results
    from cellwright.engine.formats.interop.results.json_and_csv import (
        results_entry as results_entry,
    )
    from cellwright.engine.formats.interop.shop_files import shop_of as shop_of
    from cellwright.engine.formats.interop.visit_files import is_tsplib as is_tsplib
    from cellwright.engine.formats.interop.visit_files import visits_of_target as visits_of_target
else:
    __getattr__ = open_doorway(
        __name__,
        {
            ".behaviour_trees": ("write_behaviour_tree",),
            ".calibration_files": (
                "read_held",
                "read_plates",
            ),
            ".depth_files": (
                "read_cloud",
                "read_depth",
            ),
            ".inspection_files": (
                "as_qif",
                "edit_measurements",
                "import_file",
                "inspection_remarks",
            ),
            ".measured_alignment": (
                "datums_of",
                "read_results",
                "write_moved",
            ),
            ".measurement_tables": ("unit_m",),
            ".operator_events": ("read_acts",),
            ".pddl": ("read_pddl_task",),
            ".pddl.competition_plans": (
                "read_plan",
                "write_plan",
            ),
            ".pddl.durative": ("has_times",),
            ".pddl.export": (
                "export_problem",
                "read_exported_plan",
                "write_pddl_files",
            ),
            ".pnml": ("write_contact_net",),
            ".range_files": (
                "read_ranges",
                "write_ranges",
            ),
            ".results": (
                "ResultForm",
                "write_results",
            ),
            ".results.json_and_csv": ("results_entry",),
            ".shop_files": ("shop_of",),
            ".visit_files": (
                "is_tsplib",
                "visits_of_target",
            ),
        },
    )
