"""The forms in which `plan` writes a plan: table, JSON, picture (SVG, DOT), or text for PDDL
planners.
"""

from enum import StrEnum


class PlanForm(StrEnum):
    """How a plan is written: as a table, as data, as a picture of its partial order, or in the
    format of PDDL planners.
    """

    TEXT = "text"
    JSON = "json"
    DOT = "dot"
    SVG = "svg"
    IPC = "ipc"
