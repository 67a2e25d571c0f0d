"""The checker of time: whether a time-triggered plan is right, by the text of PDDL 2.1 (Fox & Long
2003, section 8).

- What starts, ends or happens by itself at one time is one happening. Its conditions are read in
  the state before it.
- Two instants that exclude each other (definition 12, the rule of no moving targets) are at least
  epsilon apart.
- A condition over all of a step holds in every state after its start and before its end.
- The goal is read after the last step and after the last timed change.

The checker shares no code with the search: it reads actions with their variables and grounds
nothing beforehand.
"""

from cellwright.engine.stages.instants.breaches import Breach
from cellwright.engine.stages.instants.timed_replay import Replay
from cellwright.kb.model.durative import TemporalProblem, TimedPlan


def breaches(problem: TemporalProblem, plan: TimedPlan) -> list[Breach]:
    """Everything that is wrong with a plan, in the order of time; an empty list if the plan is
    right.
    """
    return Replay(problem, plan).breaches()


__all__ = ["Breach", "breaches"]
