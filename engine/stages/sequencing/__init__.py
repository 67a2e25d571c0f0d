"""Sequencing: the order of visits with the least travel cost.

The methods are the chain of 1987 as a baseline, annealed exchanges with the bound of Held and Karp,
and CP-SAT for proofs and side conditions. What a visit is and where the costs come from is decided
elsewhere.
"""

from cellwright.engine.stages.sequencing.search_limits import TourLimits
from cellwright.engine.stages.sequencing.tour_solver import METHODS, sequence_tour

__all__ = ["METHODS", "TourLimits", "sequence_tour"]
