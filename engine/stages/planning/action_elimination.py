"""Action elimination: drops the steps that a plan does not need (Nakhost & Müller 2010).

A trial compares two runs of the plan, one with a step and one without it. It keeps only the atoms
in which the states of the two runs differ, and looks only at later steps that touch one of these
atoms. So a trial is short if the step is needed, and for a long plan all trials together cost
little more than one pass.
"""

from collections.abc import Sequence

from cellwright.engine.kernels.bits import Bits, indices
from cellwright.engine.model.ground_task import GroundOperator, GroundTask
from cellwright.engine.model.workflow_replay import (
    STAGE_OPERATOR,
    reach_stages_early,
    reached_goals,
    reaching_operators,
    settling_operators,
)
from cellwright.engine.stages.planning.search_control import Effort


def eliminate_actions(
    initial: Bits, steps: Sequence[GroundOperator], goals: Bits
) -> list[GroundOperator]:
    """The steps that are left after each step was dropped on trial.

    A step is dropped for good, together with all steps that cannot run without it, if the goals
    still hold at the end.
    """
    trial = _Trial(initial, steps, goals)
    for position in range(len(steps)):
        if trial.alive >> position & 1:
            dropped = trial.dropped_with(position)
            if dropped is not None:
                trial.drop(dropped)
    return [steps[position] for position in indices(trial.alive)]


class _Trial:
    """The steps that are left (`alive`, a bitset of positions), and the state before each step."""

    def __init__(self, initial: Bits, steps: Sequence[GroundOperator], goals: Bits) -> None:
        self.steps, self.goals = steps, goals
        self.alive = (1 << len(steps)) - 1
        self.touching: dict[int, Bits] = {}
        for position, step in enumerate(steps):
            for atom in indices(step.preconditions | step.adds | step.deletes):
                self.touching[atom] = self.touching.get(atom, 0) | 1 << position
        self.before = [initial] * (len(steps) + 1)
        self.settled = [goals] * (len(steps) + 1)
        self._follow(0)

    def _follow(self, first: int) -> None:
        """Computes the states from step `first` on, and for each step the goals that no later
        step adds.
        """
        state = self.before[first]
        for position in range(first, len(self.steps)):
            self.before[position] = state
            if self.alive >> position & 1:
                step = self.steps[position]
                state = state & ~step.deletes | step.adds
        settled = self.goals
        for position in range(len(self.steps) - 1, -1, -1):
            self.settled[position] = settled
            if self.alive >> position & 1:
                settled &= ~self.steps[position].adds

    def drop(self, positions: Bits) -> None:
        """Takes steps out of the plan."""
        self.alive &= ~positions
        self._follow((positions & -positions).bit_length() - 1)

    def dropped_with(self, position: int) -> Bits | None:
        """The step at `position` and the steps that cannot run without it, as a bitset of
        positions.

        None if a goal would be lost without them.
        """
        dropped = 1 << position
        lost, gained = self._skipped(position, 0, 0)
        later = self.alive & -1 << position + 1
        while lost:
            coming = self._touched(lost | gained) & later
            if lost & self.settled[position] or not coming:
                return None if lost & self.goals else dropped
            position = (coming & -coming).bit_length() - 1
            later &= -1 << position + 1
            step = self.steps[position]
            if step.preconditions & lost:
                dropped |= 1 << position
                lost, gained = self._skipped(position, lost, gained)
            else:
                lost, gained = (
                    lost & ~(step.adds | step.deletes),
                    gained & ~(step.adds | step.deletes),
                )
        return dropped

    def _skipped(self, position: int, lost: Bits, gained: Bits) -> tuple[Bits, Bits]:
        """The atoms that are missing or left over after a step that only one of the two runs
        has.
        """
        step, state = self.steps[position], self.before[position]
        ran = state & ~step.deletes | step.adds
        stayed = state & ~lost | gained
        return ran & ~stayed, stayed & ~ran

    def _touched(self, atoms: Bits) -> Bits:
        touched = 0
        for atom in indices(atoms):
            touched |= self.touching.get(atom, 0)
        return touched


def achieved_goal(task: GroundTask, steps: Sequence[GroundOperator]) -> Bits:
    """The alternative of the goals that holds at the end of a sequence, without derived atoms."""
    state = task.initial
    for operator in steps:
        state = task.after(state, operator)
    goals_met = reached_goals(task, state)
    assert goals_met is not None
    return goals_met


Steps = list[GroundOperator]


def without_needless(task: GroundTask, steps: Sequence[GroundOperator], effort: Effort) -> Steps:
    """The steps that are left after each was dropped on trial, with all that cannot be done without
    it.

    Every step that is replayed counts as a node of the effort.
    """
    replay = _Replay(task)
    remaining = [step for step in steps if step.instance.name != STAGE_OPERATOR]
    place, before = 0, task.initial
    while place < len(remaining) and not effort.over():
        effort.generated += len(remaining) - place
        rest = replay.rest(before, remaining[place + 1 :])
        if rest is None:
            before = replay.after(before, remaining[place])
            place += 1
        else:
            remaining[place:] = rest
    return reach_stages_early(task, remaining)


class _Replay:
    """Carries steps out, and reaches each stage as soon as it can be reached."""

    def __init__(self, task: GroundTask) -> None:
        self.task, self.reaching = task, reaching_operators(task)

    def after(self, state: Bits, step: GroundOperator) -> Bits:
        """The state after a step, with the stages that are reached then."""
        state = self.task.after(state, step)
        for stage_operator in settling_operators(state, self.reaching) if self.reaching else ():
            state = self.task.after(state, stage_operator)
        return state

    def rest(self, state: Bits, steps: Sequence[GroundOperator]) -> Steps | None:
        """Those of the steps that can be done from a state on; None if they do not lead to the
        goals.
        """
        done = []
        for step in steps:
            if not step.preconditions & ~state:
                state = self.after(state, step)
                done.append(step)
        return done if reached_goals(self.task, state) is not None else None
