"""Action elimination by replay, for plans with quantities or derived atoms (Nakhost & Müller 2010).

Where steps change quantities, each step depends on the values that earlier steps leave, so a plan whose steps are fixed to their
values has no needless step. Here a plan is carried out anew without a step: values may differ then, if what is asked of them holds.
"""

from collections.abc import Sequence

from cellwright.engine.model.replay import early, reached_goals, reaching_operators, settling
from cellwright.engine.model.stages import REACHES
from cellwright.engine.model.task import Bits, GroundOperator, Task
from cellwright.engine.stages.planning.effort import Effort

Steps = list[GroundOperator]


def without_needless(task: Task, steps: Sequence[GroundOperator], effort: Effort) -> Steps:
    """The steps that are left after each was dropped on trial, with all that cannot be done without it.

    Every step that is replayed counts as a node of the effort.
    """
    replay = _Replay(task)
    left = [step for step in steps if step.instance.name != REACHES]
    place, before = 0, task.initial
    while place < len(left) and not effort.over():
        effort.generated += len(left) - place
        rest = replay.rest(before, left[place + 1 :])
        if rest is None:
            before = replay.after(before, left[place])
            place += 1
        else:
            left[place:] = rest
    return early(task, left)


class _Replay:
    """Carries steps out, and reaches each stage as soon as it can be reached."""

    def __init__(self, task: Task) -> None:
        self.task, self.reaching = task, reaching_operators(task)

    def after(self, state: Bits, step: GroundOperator) -> Bits:
        """The state after a step, with the stages that are reached then."""
        state = self.task.after(state, step)
        for each in settling(state, self.reaching) if self.reaching else ():
            state = self.task.after(state, each)
        return state

    def rest(self, state: Bits, steps: Sequence[GroundOperator]) -> Steps | None:
        """Those of the steps that can be done from a state on; None if they do not lead to the goals."""
        done = []
        for step in steps:
            if not step.preconditions & ~state:
                state = self.after(state, step)
                done.append(step)
        return done if reached_goals(self.task, state) is not None else None
