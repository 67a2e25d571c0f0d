"""Sequencing: the order of visits with the least travel cost.

The methods are the chain of 1987 as a baseline, annealed exchanges with the bound of Held and Karp, and
CP-SAT for proofs and side conditions. What a visit is and where the costs come from is decided elsewhere.
"""

from cellwright.engine.stages.sequencing.limits import Limits
from cellwright.engine.stages.sequencing.sequence import METHODS, sequence

__all__ = ["METHODS", "Limits", "sequence"]
