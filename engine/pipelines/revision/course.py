"""A plan under way: its steps as ground operators, and the conditions under which its last steps lead to the goal.

The last steps of a plan, from any position on, are called a tail. The conditions that a tail needs are its kernel in the
triangle table (Fikes, Hart & Nilsson 1972): the goal regressed through the tail.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from cellwright.engine.model.quantities import Comparing, Level
from cellwright.engine.model.replay import Instances, instances, reached_at_the_end, replayed, settled
from cellwright.engine.model.stages import STAGE, stage_atom
from cellwright.engine.model.task import Bits, GroundOperator, Task, indices
from cellwright.engine.pipelines.gate import PlanGate
from cellwright.engine.pipelines.planning import task_for
from cellwright.engine.stages.macros.lifted.situation import Situation
from cellwright.engine.stages.macros.lifted.world import CellDomain
from cellwright.kb.model.plan import Plan
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import Atom, Function, Number


@dataclass(frozen=True)
class Course:
    """A problem, the plan that is being executed, the ground task, the start situation, and the gate for repairs."""

    problem: Problem
    plan: Plan
    task: Task
    start: Situation
    gate: PlanGate

    @classmethod
    def of(cls, problem: Problem, plan: Plan) -> "Course":
        """Ground the problem once, so that revisions need not ground it again. Raises `InvalidInput`."""
        gate = PlanGate()
        start = Situation.of(CellDomain(problem), gate.semantics(problem).initial())
        return cls(problem, plan, task_for(problem, plan), start, gate)

    @cached_property
    def index(self) -> Mapping[Atom, int]:
        """The number of each atom."""
        return {atom: number for number, atom in enumerate(self.task.atoms)}

    @cached_property
    def instances(self) -> Instances:
        """The ground operators of each instance."""
        return instances(self.task)

    def bits(self, observed: Iterable[Atom], reached: Mapping[str, int]) -> Bits:
        """A state of the task: what is observed, the stages reached and those that hold now, complements; atoms it does not
        know are left out."""
        found = 0
        for atom in observed:
            found |= 1 << self.index[atom] if atom in self.index else self._value(atom)
        for level in self._levels.values():
            found |= 0 if found & level.mask else self.task.initial & level.mask
        for chain in self.problem.chains:
            found |= 1 << self.index[stage_atom(chain, reached[chain.name])]
        for number, atom in enumerate(self.task.atoms):
            if atom.name == "not" and len(atom.arguments) == 1:
                inner = atom.arguments[0]
                assert isinstance(inner, Function)
                if not found >> self.index[inner] & 1:
                    found |= 1 << number
            elif atom.name.startswith("_") and atom.name != STAGE and self.task.initial >> number & 1:
                found |= 1 << number
        return settled(self.task, found)

    @cached_property
    def _levels(self) -> Mapping[Atom, Level]:
        """The quantities of the task by their names."""
        changes = [change for operator in self.task.operators for change in operator.changes]
        sums = [change.to for change in changes] + [each.sum for each in self._compared]
        found = [change.level for change in changes] + [level for each in sums for level, _ in each.parts]
        return {level.quantity: level for level in found}

    @property
    def _compared(self) -> Sequence[Comparing]:
        return self.task.axioms.tests if self.task.axioms is not None else ()

    def _value(self, atom: Atom) -> Bits:
        """The atom for a value of a quantity, which no search has met yet; nothing for other atoms."""
        level = self._levels.get(Function(atom.name, atom.arguments[:-1]))
        if level is None or not isinstance(last := atom.arguments[-1], Number):
            return 0
        return level.bit(last.value)

    def executed(self, state: Bits, steps: Iterable[Function]) -> list[GroundOperator] | None:
        """The ground operators of instances taken one after another from a state, with the internal ones that reach stages
        between them; None if an instance cannot be taken."""
        return replayed(self.task, self.instances, state, steps)

    def kernels(self, steps: Sequence[GroundOperator], goals: Bits) -> list[Bits]:
        """For each position, the atoms that the steps from there on need to reach the goals; the last are the goals."""
        found = [goals]
        for operator in reversed(steps):
            found.append((found[-1] & ~operator.adds) | operator.preconditions)
        return found[::-1]

    def reached_goals(self, state: Bits) -> Bits | None:
        """The alternative of the goals that holds in a state; None if none holds."""
        return reached_at_the_end(self.task, state)

    def named(self, bits: Bits) -> tuple[Atom, ...]:
        """The atoms in a bitset."""
        return tuple(self.task.atoms[number] for number in indices(bits))
