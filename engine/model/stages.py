"""How many stages of a chain are reached, as a fluent: what a task counts, and causal links name."""

from kb.model.problem import Chain
from kb.terms import Atom, Function, Number, Text

STAGE = "_stage"


def stage_atom(chain: Chain, reached: int) -> Atom:
    """The fluent that says how many stages of a chain are reached."""
    return Function(STAGE, (Text(chain.name), Number(reached)))
