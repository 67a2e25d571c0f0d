"""A plan under way: its steps as ground operators, and the conditions under which its last steps lead to the goal.

The last steps of a plan, from any position on, are called a tail. The conditions that a tail needs are its kernel in the
triangle table (Fikes, Hart & Nilsson 1972): the goal regressed through the tail.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from engine.model.replay import Instances, instances, reached_goals, replayed
from engine.model.stages import STAGE, stage_atom
from engine.model.task import Bits, GroundOperator, Task, indices
from engine.pipelines.gate import PlanGate
from engine.stages.grounding import ground
from engine.stages.macros.lifted.situation import Situation
from engine.stages.macros.lifted.world import CellDomain
from kb.model.plan import Plan
from kb.model.problem import Problem
from kb.terms import Atom, Function


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
        return cls(problem, plan, ground(problem), start, gate)

    @cached_property
    def index(self) -> Mapping[Atom, int]:
        """The number of each atom."""
        return {atom: number for number, atom in enumerate(self.task.atoms)}

    @cached_property
    def instances(self) -> Instances:
        """The ground operators of each instance."""
        return instances(self.task)

    def bits(self, observed: Iterable[Atom], reached: Mapping[str, int]) -> Bits:
        """A state of the task: the observed atoms that the task has, the stages reached, and complements."""
        found = sum({1 << self.index[atom] for atom in observed if atom in self.index})
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
        return found

    def executed(self, state: Bits, steps: Iterable[Function]) -> list[GroundOperator] | None:
        """The ground operators of `steps`, executed one after another from `state`; None if one is not applicable."""
        return replayed(self.instances, state, steps)

    def kernels(self, steps: Sequence[GroundOperator], goals: Bits) -> list[Bits]:
        """For each position, the atoms that the steps from there on need to reach the goals; the last are the goals."""
        found = [goals]
        for operator in reversed(steps):
            found.append((found[-1] & ~operator.adds) | operator.preconditions)
        return found[::-1]

    def reached_goals(self, state: Bits) -> Bits | None:
        """The alternative of the goals that holds in a state; None if none holds."""
        return reached_goals(self.task, state)

    def named(self, bits: Bits) -> tuple[Atom, ...]:
        """The atoms in a bitset."""
        return tuple(self.task.atoms[number] for number in indices(bits))
