"""Cellwright as a library: one function for each thing that the command line does, and answers that show themselves.

    import cellwright

    answer = cellwright.plan("bulkhead/one_point")
    print(answer)            # the table that the command line prints
    answer.plan.steps        # values to compute with
    answer                   # in a notebook: its picture

For bad input, functions raise `InvalidInput` with every error and its place. That there is no plan is an answer.

What this module exports is stable (docs/api.md); the modules below it are not. Nothing is imported before it is used.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cellwright.answers import Answer as Answer
    from cellwright.answers import Told as Told
    from cellwright.cases import DecisionTree as DecisionTree
    from cellwright.cases import Diagnosed as Diagnosed
    from cellwright.cases import decision_tree as decision_tree
    from cellwright.cases import diagnose as diagnose
    from cellwright.engine.model.outcome import Found as Found
    from cellwright.engine.model.outcome import GaveUp as GaveUp
    from cellwright.engine.model.outcome import Infeasible as Infeasible
    from cellwright.engine.model.outcome import Outcome as Outcome
    from cellwright.files import Imported as Imported
    from cellwright.files import compare_golden as compare_golden
    from cellwright.files import devices as devices
    from cellwright.files import export_behaviour_tree as export_behaviour_tree
    from cellwright.files import export_pddl as export_pddl
    from cellwright.files import export_qif as export_qif
    from cellwright.files import format_files as format_files
    from cellwright.files import import_points as import_points
    from cellwright.files import init as init
    from cellwright.files import read_pddl as read_pddl
    from cellwright.files import read_pddl_plan as read_pddl_plan
    from cellwright.files import schema as schema
    from cellwright.files import write_pddl_plan as write_pddl_plan
    from cellwright.kb.diagnostics import Diagnostic as Diagnostic
    from cellwright.kb.diagnostics import InvalidInput as InvalidInput
    from cellwright.kb.model.plan import Plan as Plan
    from cellwright.kb.model.plan import Step as Step
    from cellwright.kb.model.problem import Problem as Problem
    from cellwright.libraries import back_up as back_up
    from cellwright.libraries import check_store as check_store
    from cellwright.libraries import export_macros as export_macros
    from cellwright.libraries import forget as forget
    from cellwright.libraries import import_macros as import_macros
    from cellwright.libraries import keep_sequence as keep_sequence
    from cellwright.libraries import learn as learn
    from cellwright.libraries import macros as macros
    from cellwright.libraries import migrate as migrate
    from cellwright.libraries import prepare as prepare
    from cellwright.libraries import restore as restore
    from cellwright.measuring import align as align
    from cellwright.measuring import fit as fit
    from cellwright.measuring import image as image
    from cellwright.measuring import measurements as measurements
    from cellwright.measuring import recognise as recognise
    from cellwright.places import assemble as assemble
    from cellwright.places import cell as cell
    from cellwright.places import motion as motion
    from cellwright.places import place as place
    from cellwright.places import states as states
    from cellwright.places import travel as travel
    from cellwright.plans import Planned as Planned
    from cellwright.plans import Revised as Revised
    from cellwright.plans import Verdict as Verdict
    from cellwright.plans import plan as plan
    from cellwright.plans import revise as revise
    from cellwright.plans import validate as validate
    from cellwright.reasons import Checked as Checked
    from cellwright.reasons import Explained as Explained
    from cellwright.reasons import Reason as Reason
    from cellwright.reasons import check as check
    from cellwright.reasons import explain as explain
    from cellwright.reasons import why as why
    from cellwright.requests import load as load
    from cellwright.running import Ran as Ran
    from cellwright.running import results as results
    from cellwright.running import resume as resume
    from cellwright.running import run as run
    from cellwright.running import runs as runs
    from cellwright.running import tell as tell
    from cellwright.times import Scheduled as Scheduled
    from cellwright.times import Toured as Toured
    from cellwright.times import schedule as schedule
    from cellwright.times import sequence as sequence

_WHERE = {
    "cellwright.answers": ("Answer", "Told"),
    "cellwright.cases": ("DecisionTree", "Diagnosed", "decision_tree", "diagnose"),
    "cellwright.files": (
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
    "cellwright.libraries": (
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
    "cellwright.measuring": ("align", "fit", "image", "measurements", "recognise"),
    "cellwright.places": ("assemble", "cell", "motion", "place", "states", "travel"),
    "cellwright.plans": ("Planned", "Revised", "Verdict", "plan", "revise", "validate"),
    "cellwright.reasons": ("Checked", "Explained", "Reason", "check", "explain", "why"),
    "cellwright.requests": ("load",),
    "cellwright.running": ("Ran", "results", "resume", "run", "runs", "tell"),
    "cellwright.times": ("Scheduled", "Toured", "schedule", "sequence"),
    "cellwright.engine.model.outcome": ("Found", "GaveUp", "Infeasible", "Outcome"),
    "cellwright.kb.diagnostics": ("Diagnostic", "InvalidInput"),
    "cellwright.kb.model.plan": ("Plan", "Step"),
    "cellwright.kb.model.problem": ("Problem",),
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
    "prepare",
    "read_pddl",
    "read_pddl_plan",
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
    "why",
    "write_pddl_plan",
]


def __getattr__(name: str) -> Any:
    """A public name, imported when it is first asked for."""
    if name not in _MODULES:
        raise AttributeError(f"module 'cellwright' has no attribute '{name}'")
    found = getattr(import_module(_MODULES[name]), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted(__all__)
