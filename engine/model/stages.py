"""The fluent for the number of stages of a chain that are reached. Ground tasks and causal links use it.

A stage that is a fluent is reached by an internal operator of the task, where the fluent holds.
"""

from cellwright.kb.model.problem import Chain
from cellwright.kb.terms import Atom, Function, Number, Text

STAGE = "_stage"
REACHES = "_reaches"
# Internal operators: one ends a plan, the others say then how a goal holds.
ENDS, MEETS = "_ends", "_meets"


def stage_atom(chain: Chain, reached: int) -> Atom:
    """The fluent that says how many stages of a chain are reached."""
    return Function(STAGE, (Text(chain.name), Number(reached)))


def reaching(chain: Chain, count: int) -> Function:
    """The internal operator that moves a chain to a count of stages."""
    return Function(REACHES, (Text(chain.name), Number(count)))


def said_of(atom: Atom) -> str:
    """An atom in words for people: that of a stage says how many stages of a chain are reached."""
    if atom.name != STAGE:
        return str(atom)
    chain, count = atom.arguments
    name = chain.value if isinstance(chain, Text) else chain
    return f"stage {count} of {name}"
