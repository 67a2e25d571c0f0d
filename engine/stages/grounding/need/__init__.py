"""Grounding by need: only what the goals can need from the state is grounded.

What is relevant is found backwards over operators with variables. Objects that are alike there, and that play no part, are
left out except for a few. Then the rest is grounded, and what contributes to no goal is left out, too. Whether the small task
is as good as the whole one is proved on it; where it is not, the caller grounds the whole.
"""

from cellwright.engine.stages.grounding.need.faithful import faithful, without_irrelevant
from cellwright.engine.stages.grounding.need.relevance import relevance
from cellwright.engine.stages.grounding.need.thinning import Named, Thinned, thinned

__all__ = ["Named", "Thinned", "faithful", "relevance", "thinned", "without_irrelevant"]
