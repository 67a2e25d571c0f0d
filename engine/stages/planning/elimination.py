"""Action elimination: drops the steps that a plan does not need (Nakhost & Müller 2010).

A trial compares two runs of the plan, one with a step and one without it. It keeps only the atoms in which
the states of the two runs differ, and looks only at later steps that touch one of these atoms. So a trial is
short if the step is needed, and for a long plan all trials together cost little more than one pass.
"""

from collections.abc import Sequence

from cellwright.engine.model.replay import reached_goals
from cellwright.engine.model.task import Bits, GroundOperator, Task, indices


def eliminate(initial: Bits, steps: Sequence[GroundOperator], goals: Bits) -> list[GroundOperator]:
    """The steps that are left after each step was dropped on trial.

    A step is dropped for good, together with all steps that cannot run without it, if the goals still hold at
    the end.
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
        """Computes the states from step `first` on, and for each step the goals that no later step adds."""
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
        """The step at `position` and the steps that cannot run without it, as a bitset of positions.

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
                lost, gained = lost & ~(step.adds | step.deletes), gained & ~(step.adds | step.deletes)
        return dropped

    def _skipped(self, position: int, lost: Bits, gained: Bits) -> tuple[Bits, Bits]:
        """The atoms that are missing or left over after a step that only one of the two runs has."""
        step, state = self.steps[position], self.before[position]
        ran = state & ~step.deletes | step.adds
        stayed = state & ~lost | gained
        return ran & ~stayed, stayed & ~ran

    def _touched(self, atoms: Bits) -> Bits:
        found = 0
        for atom in indices(atoms):
            found |= self.touching.get(atom, 0)
        return found


def reached(task: Task, steps: Sequence[GroundOperator]) -> Bits:
    """The alternative of the goals that holds at the end of a sequence, without derived atoms."""
    state = task.initial
    for operator in steps:
        state = task.after(state, operator)
    found = reached_goals(task, state)
    assert found is not None
    return found
