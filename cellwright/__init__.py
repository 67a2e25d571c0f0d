"""Cellwright as a library: one function for each thing that the command line does, and answers that
show themselves.

    import cellwright

    answer = cellwright.plan("bulkhead/one_point")
    print(answer)            # the table that the command line prints
    answer.plan.steps        # values to compute with
    answer                   # in a notebook: its picture

For bad input, functions raise `InvalidInput` with every error and its place. That there is no plan
is an answer.

What this module exports is stable (docs/api.md); the modules below it are not. Nothing is imported
before it is used.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cellwright.diagnosis_functions import DecisionTree as DecisionTree
    from cellwright.diagnosis_functions import Diagnosed as Diagnosed
    from cellwright.diagnosis_functions import decision_tree as decision_tree
    from cellwright.diagnosis_functions import diagnose as diagnose
    from cellwright.engine.model.outcome import Found as Found
    from cellwright.engine.model.outcome import GaveUp as GaveUp
    from cellwright.engine.model.outcome import Infeasible as Infeasible
    from cellwright.engine.model.outcome import Outcome as Outcome
    from cellwright.file_functions import Imported as Imported
    from cellwright.file_functions import compare_golden as compare_golden
    from cellwright.file_functions import devices as devices
    from cellwright.file_functions import export_behaviour_tree as export_behaviour_tree
    from cellwright.file_functions import export_pddl as export_pddl
    from cellwright.file_functions import export_qif as export_qif
    from cellwright.file_functions import format_files as format_files
    from cellwright.file_functions import import_points as import_points
    from cellwright.file_functions import init as init
    from cellwright.file_functions import read_pddl as read_pddl
    from cellwright.file_functions import read_pddl_plan as read_pddl_plan
    from cellwright.file_functions import schema as schema
    from cellwright.file_functions import write_pddl_plan as write_pddl_plan
    from cellwright.geometry_functions import align as align
    from cellwright.geometry_functions import assemble as assemble
    from cellwright.geometry_functions import cell as cell
    from cellwright.geometry_functions import fit as fit
    from cellwright.geometry_functions import image as image
    from cellwright.geometry_functions import measurements as measurements
    from cellwright.geometry_functions import motion as motion
    from cellwright.geometry_functions import place as place
    from cellwright.geometry_functions import recognise as recognise
    from cellwright.geometry_functions import states as states
    from cellwright.geometry_functions import travel as travel
    from cellwright.kb.diagnostics import Diagnostic as Diagnostic
    from cellwright.kb.diagnostics import InvalidInput as InvalidInput
    from cellwright.kb.model.plan_model import Plan as Plan
    from cellwright.kb.model.plan_model import Step as Step
    from cellwright.kb.model.planning_problem import Problem as Problem
    from cellwright.library_base import Answer as Answer
    from cellwright.library_base import Told as Told
    from cellwright.library_base import load as load
    from cellwright.plan_functions import Checked as Checked
    from cellwright.plan_functions import Explained as Explained
    from cellwright.plan_functions import Planned as Planned
    from cellwright.plan_functions import Reason as Reason
    from cellwright.plan_functions import Revised as Revised
    from cellwright.plan_functions import Verdict as Verdict
    from cellwright.plan_functions import check as check
    from cellwright.plan_functions import explain as explain
    from cellwright.plan_functions import plan as plan
    from cellwright.plan_functions import revise as revise
    from cellwright.plan_functions import validate as validate
    from cellwright.plan_functions import why as why
    from cellwright.run_functions import Ran as Ran
    from cellwright.run_functions import results as results
    from cellwright.run_functions import resume as resume
    from cellwright.run_functions import run as run
    from cellwright.run_functions import runs as runs
    from cellwright.run_functions import tell as tell
    from cellwright.schedule_functions import Scheduled as Scheduled
    from cellwright.schedule_functions import Toured as Toured
    from cellwright.schedule_functions import schedule as schedule
    from cellwright.schedule_functions import sequence as sequence
    from cellwright.store_functions import back_up as back_up
    from cellwright.store_functions import check_store as check_store
    from cellwright.store_functions import export_macros as export_macros
    from cellwright.store_functions import forget as forget
    from cellwright.store_functions import import_macros as import_macros
    from cellwright.store_functions import keep_sequence as keep_sequence
    from cellwright.store_functions import learn as learn
    from cellwright.store_functions import macros as macros
    from cellwright.store_functions import migrate as migrate
    from cellwright.store_functions import prepare as prepare
    from cellwright.store_functions import restore as restore
    from cellwright.timed_functions import TimedPlanned as TimedPlanned
    from cellwright.timed_functions import TimedTask as TimedTask
    from cellwright.timed_functions import TimedVerdict as TimedVerdict
    from cellwright.timed_functions import plan_timed as plan_timed
    from cellwright.timed_functions import read_timed_pddl as read_timed_pddl
    from cellwright.timed_functions import validate_timed as validate_timed

_WHERE = {
    "cellwright.library_base": (
        "Answer",
        "Told",
        "load",
    ),
    "cellwright.diagnosis_functions": (
        "DecisionTree",
        "Diagnosed",
        "decision_tree",
        "diagnose",
    ),
    "cellwright.file_functions": (
        "Imported",
        "compare_golden",
        "devices",
        "export_behaviour_tree",
        "export_pddl",
        "export_qif",
        "format_files",
        "import_points",
        "init",
        "read_pddl",
        "read_pddl_plan",
        "schema",
        "write_pddl_plan",
    ),
    "cellwright.store_functions": (
        "back_up",
        "check_store",
        "export_macros",
        "forget",
        "import_macros",
        "keep_sequence",
        "learn",
        "macros",
        "migrate",
        "prepare",
        "restore",
    ),
    "cellwright.geometry_functions": (
        "align",
        "fit",
        "image",
        "measurements",
        "recognise",
        "assemble",
        "cell",
        "motion",
        "place",
        "states",
        "travel",
    ),
    "cellwright.plan_functions": (
        "Planned",
        "Revised",
        "Verdict",
        "plan",
        "revise",
        "validate",
        "Checked",
        "Explained",
        "Reason",
        "check",
        "explain",
        "why",
    ),
    "cellwright.run_functions": (
        "Ran",
        "results",
        "resume",
        "run",
        "runs",
        "tell",
    ),
    "cellwright.timed_functions": (
        "TimedPlanned",
        "TimedTask",
        "TimedVerdict",
        "plan_timed",
        "read_timed_pddl",
        "validate_timed",
    ),
    "cellwright.schedule_functions": (
        "Scheduled",
        "Toured",
        "schedule",
        "sequence",
    ),
    "cellwright.engine.model.outcome": (
        "Found",
        "GaveUp",
        "Infeasible",
        "Outcome",
    ),
    "cellwright.kb.diagnostics": (
        "Diagnostic",
        "InvalidInput",
    ),
    "cellwright.kb.model.plan_model": (
        "Plan",
        "Step",
    ),
    "cellwright.kb.model.planning_problem": ("Problem",),
}
"""The public names, by the module that has each."""

_MODULES = {name: module for module, names in _WHERE.items() for name in names}

__all__ = [
    "Answer",
    "Checked",
    "DecisionTree",
    "Diagnosed",
    "Diagnostic",
    "Explained",
    "Found",
    "GaveUp",
    "Imported",
    "Infeasible",
    "InvalidInput",
    "Outcome",
    "Plan",
    "Planned",
    "Problem",
    "Ran",
    "Reason",
    "Revised",
    "Scheduled",
    "Step",
    "TimedPlanned",
    "TimedTask",
    "TimedVerdict",
    "Told",
    "Toured",
    "Verdict",
    "align",
    "assemble",
    "back_up",
    "cell",
    "check",
    "check_store",
    "compare_golden",
    "decision_tree",
    "devices",
    "diagnose",
    "explain",
    "export_behaviour_tree",
    "export_macros",
    "export_pddl",
    "export_qif",
    "fit",
    "forget",
    "format_files",
    "image",
    "import_macros",
    "import_points",
    "init",
    "keep_sequence",
    "learn",
    "load",
    "macros",
    "measurements",
    "migrate",
    "motion",
    "place",
    "plan",
    "plan_timed",
    "prepare",
    "read_pddl",
    "read_pddl_plan",
    "read_timed_pddl",
    "recognise",
    "restore",
    "results",
    "resume",
    "revise",
    "run",
    "runs",
    "schedule",
    "schema",
    "sequence",
    "states",
    "tell",
    "travel",
    "validate",
    "validate_timed",
    "why",
    "write_pddl_plan",
]


def __getattr__(name: str) -> Any:
    """A public name, imported when it is first asked for."""
    if name not in _MODULES:
        raise AttributeError(f"module 'cellwright' has no attribute '{name}'")
    public_value = getattr(import_module(_MODULES[name]), name)
    globals()[name] = public_value
    return public_value


def __dir__() -> list[str]:
    return sorted(__all__)
