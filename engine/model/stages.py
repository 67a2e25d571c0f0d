"""The fluent for the number of stages of a chain that are reached. Ground tasks and causal links use it."""

from kb.model.problem import Chain
from kb.terms import Atom, Function, Number, Text

STAGE = "_stage"


def stage_atom(chain: Chain, reached: int) -> Atom:
    """The fluent that says how many stages of a chain are reached."""
    return Function(STAGE, (Text(chain.name), Number(reached)))
