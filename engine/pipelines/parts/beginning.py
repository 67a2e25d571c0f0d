"""Where the parts of a plan begin: a chain that stands in the initial state of a problem."""

from engine.pipelines.parts.chain import Chain
from engine.pipelines.parts.memory import Memory, Notebook
from engine.stages.grounding.initial import initial_state
from engine.stages.grounding.program import Vocabulary
from engine.stages.macros.lifted.situation import Situation
from engine.stages.macros.lifted.world import CellDomain
from engine.stages.planning import Limits
from engine.stages.sequencing import Limits as TourLimits
from kb.diagnostics import InvalidInput
from kb.model.problem import Problem


def start_of(problem: Problem) -> Situation:
    """The initial state of a problem. Raises `InvalidInput` if its facts contradict one another."""
    state, contradicted = initial_state(problem, Vocabulary(problem.domain))
    if contradicted:
        raise InvalidInput(contradicted)
    return Situation.of(CellDomain(problem), state)


def chain_of(problem: Problem, limits: TourLimits, memory: Memory | None = None) -> Chain:
    """A chain at the start of a problem, within the limits of a sequence."""
    own = Limits(seed=limits.seed, interrupted=limits.interrupted)
    return Chain(problem, start_of(problem), memory or Notebook(), own)
