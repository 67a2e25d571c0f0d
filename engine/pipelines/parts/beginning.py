"""Where the parts of a plan begin: a chain that stands in the initial state of a problem."""

from cellwright.engine.pipelines.parts.chain import Chain
from cellwright.engine.pipelines.parts.memory import Memory, Notebook
from cellwright.engine.stages.grounding.initial import initial_state
from cellwright.engine.stages.grounding.program import Vocabulary
from cellwright.engine.stages.macros.lifted.situation import Situation
from cellwright.engine.stages.macros.lifted.world import CellDomain
from cellwright.engine.stages.planning import Limits
from cellwright.engine.stages.sequencing import Limits as TourLimits
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.model.problem import Problem


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
