"""What a caller chooses for a plan: what it should have least of, and who orders measurements."""

from enum import StrEnum


class PlanningObjective(StrEnum):
    """What a plan should have least of: cost, or makespan and then cost."""

    COST = "cost"
    MAKESPAN = "makespan"


class SequenceChoice(StrEnum):
    """Who decides the order of measurements: the sequencer, or the planner alone."""

    SEQUENCE = "sequence"
    FREE = "free"
