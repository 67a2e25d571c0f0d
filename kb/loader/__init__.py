"""Reads the files of a domain: domains, problems, plans, cells, contact models and fault bases."""

from typing import TYPE_CHECKING

from cellwright.kb.doorways import open_doorway

if TYPE_CHECKING:
    from cellwright.kb.loader.calibration_file import calibration_text as calibration_text
    from cellwright.kb.loader.calibration_file import load_calibration as load_calibration
    from cellwright.kb.loader.cell import cell_of as cell_of
    from cellwright.kb.loader.cell import cell_of_problem as cell_of_problem
    from cellwright.kb.loader.cell import load_cell as load_cell
    from cellwright.kb.loader.contacts import load_contacts as load_contacts
    from cellwright.kb.loader.device_uses import all_devices as all_devices
    from cellwright.kb.loader.device_uses import device_called as device_called
    from cellwright.kb.loader.domain_lookup import domain_of as domain_of
    from cellwright.kb.loader.loading import Loaded as Loaded
    from cellwright.kb.loader.loading import load as load
    from cellwright.kb.loader.loading import load_domain as load_domain
    from cellwright.kb.loader.loading import load_problem as load_problem
    from cellwright.kb.loader.loading import with_goals as with_goals
    from cellwright.kb.loader.plan import is_plan as is_plan
    from cellwright.kb.loader.plan import load_claimed as load_claimed
    from cellwright.kb.loader.plan import load_plan as load_plan
    from cellwright.kb.loader.scene_file import load_scene as load_scene
    from cellwright.kb.loader.scene_file import relation_of as relation_of
    from cellwright.kb.targets import CELL_FILE as CELL_FILE
    from cellwright.kb.targets import CONTACTS_FILE as CONTACTS_FILE
    from cellwright.kb.targets import DOMAIN_FILE as DOMAIN_FILE
    from cellwright.kb.targets import bundled_domains as bundled_domains
    from cellwright.kb.targets import domain_reference as domain_reference
    from cellwright.kb.targets import find_target as find_target
    from cellwright.kb.targets import problem_files as problem_files
else:
    __getattr__ = open_doorway(
        __name__,
        {
            ".calibration_file": (
                "calibration_text",
                "load_calibration",
            ),
            ".cell": (
                "cell_of",
                "cell_of_problem",
                "load_cell",
            ),
            ".contacts": ("load_contacts",),
            ".device_uses": (
                "all_devices",
                "device_called",
            ),
            ".domain_lookup": ("domain_of",),
            ".loading": (
                "Loaded",
                "load",
                "load_domain",
                "load_problem",
                "with_goals",
            ),
            ".plan": (
                "is_plan",
                "load_claimed",
                "load_plan",
            ),
            ".scene_file": (
                "load_scene",
                "relation_of",
            ),
            "cellwright.kb.targets": (
                "CELL_FILE",
                "CONTACTS_FILE",
                "DOMAIN_FILE",
                "bundled_domains",
                "domain_reference",
                "find_target",
                "problem_files",
            ),
        },
        libraries={".loading": ("cellwright.kb.schema.domain", "cellwright.kb.syntax")},
    )
