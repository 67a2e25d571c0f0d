"""Keeps the ground tasks of the last few cells, so that a problem with another start in a known
cell is not grounded anew.

What can be reached from a state that can itself be reached is part of what was grounded before. So
only the start and the goals of the task change. That is done for plain tasks: every atom is a
fluent or the absence of one, every goal is one literal, no chain has to be worked through, and
nothing depends on a state but preconditions.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property

from cellwright.engine.kernels.bits import Bits, bitset
from cellwright.engine.model.ground_task import GroundTask
from cellwright.engine.stages.lifted.cell_domain import CellDomain, Situation
from cellwright.engine.stages.lifted.fact_queries import is_satisfiable
from cellwright.engine.stages.lifted.ground_steps import is_plain
from cellwright.engine.stages.lifted.operator_schemas import OperatorSchema
from cellwright.kb.model.conditions import Literal, goal_parts
from cellwright.kb.model.domain_model import Kind
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Atom, Function, is_ground, match_term

ABSENT = "not"
MAX_TASKS = 4  # tasks that are kept
MAX_OPERATORS = 20_000  # of a task that is kept


@dataclass(frozen=True)
class CellTask:
    """The ground task of a problem, to be asked for other problems of its cell."""

    problem: Problem
    task: GroundTask

    @cached_property
    def is_plain(self) -> bool:
        """Whether start and goals are all in which the tasks of the cell differ."""
        task, domain = self.task, self.problem.domain
        if not task.whole or task.axioms is not None or domain.quantities or self.problem.chains:
            return False
        own = {each.name for each in domain.operators}
        fluents = {name for name, each in domain.predicates.items() if each.kind is Kind.FLUENT}
        return all(
            each.instance.name in own and not each.conditional for each in task.operators
        ) and all((_absentee(atom) or atom).name in fluents for atom in task.atoms)

    @cached_property
    def numbers(self) -> dict[Atom, int]:
        """The number of each atom, and of the absence of some."""
        return {atom: number for number, atom in enumerate(self.task.atoms)}

    @cached_property
    def absences(self) -> list[tuple[int, Atom]]:
        """The numbers that stand for the absence of an atom, each with this atom."""
        pairs = ((number, _absentee(atom)) for number, atom in enumerate(self.task.atoms))
        return [(number, atom) for number, atom in pairs if atom is not None]

    def beginning_with(self, problem: Problem, here: Situation) -> GroundTask | None:
        """The task of a problem of the cell from a situation; None if what was grounded does not
        tell.
        """
        state = here.state
        known = [atom for atom in state if atom in self.numbers or _matters(atom, here.world)]
        start, goal = self._bits(known), self._goal(problem)
        if problem.chains or start is None or goal is None:
            return None
        start |= bitset([number for number, atom in self.absences if atom not in state])
        if any((group & start).bit_count() > 1 for group in self.task.mutex_groups):
            return None
        return replace(self.task, initial=start, goals=(goal,))

    def _goal(self, problem: Problem) -> Bits | None:
        wanted: list[Atom] = []
        for part in goal_parts(problem.goal):
            if not isinstance(part, Literal) or not is_ground(part.atom):
                return None
            wanted.append(part.atom if part.positive else Function(ABSENT, (part.atom,)))
        return self._bits(wanted)

    def _bits(self, atoms: Iterable[Atom]) -> Bits | None:
        numbers = [self.numbers.get(atom) for atom in atoms]
        known = [number for number in numbers if number is not None]
        return bitset(known) if len(known) == len(numbers) else None


def _matters(atom: Atom, world: CellDomain) -> bool:
    """Whether a step in the cell may ask for an atom, or whether a step that ends it has other
    consequences.
    """
    triggers = (each.trigger for each in world.domain.deductive_operators)
    if any(not each.positive and each.atom.name == atom.name for each in triggers):
        return True
    return any(
        _asks(world.schemas.named(each.name), atom, world) for each in world.domain.operators
    )


def _asks(schema: OperatorSchema, atom: Atom, world: CellDomain) -> bool:
    if not is_plain(schema, world.schemas):
        return True
    asked = (
        part.atom for body in schema.alternatives for part in body if isinstance(part, Literal)
    )
    fitting = (match_term(each, atom, {}) for each in asked if each.name == atom.name)
    return any(
        each is not None and is_satisfiable(schema.body, world.statics, each) for each in fitting
    )


def _absentee(atom: Atom) -> Atom | None:
    """The atom whose absence an atom of a task stands for."""
    inner = atom.arguments[0] if atom.name == ABSENT and len(atom.arguments) == 1 else None
    return inner if isinstance(inner, Function) else None


class CellTasks:
    """The tasks that were grounded last."""

    def __init__(self) -> None:
        self._recent: list[CellTask] = []

    def task_of(self, problem: Problem, here: Situation) -> GroundTask | None:
        """The ground task of a problem from a situation, if a task of its cell tells it."""
        known = (each for each in self._recent if _same_cell(each.problem, problem))
        tasks = (each.beginning_with(problem, here) for each in known)
        return next((task for task in tasks if task is not None), None)

    def leaves_nothing_out(self, problem: Problem) -> bool:
        """Whether the last task of a cell with the same objects was plain and had all of them: so
        will this one, it is supposed.

        To ground a whole problem is always right. It only may take longer.
        """
        return any(_same_objects(each.problem, problem) for each in self._recent)

    def keep(self, problem: Problem, task: GroundTask) -> None:
        """Keep the task of a problem, if it serves other problems of the cell."""
        known = CellTask(problem, task)
        if len(task.operators) <= MAX_OPERATORS and known.is_plain:
            self._recent = [known, *self._recent[: MAX_TASKS - 1]]


def _same_objects(one: Problem, other: Problem) -> bool:
    return _equal((one.domain, other.domain), (one.objects, other.objects))


def _same_cell(one: Problem, other: Problem) -> bool:
    return _same_objects(one, other) and _equal(
        (one.statics, other.statics), (one.durations, other.durations)
    )


def _equal(*pairs: tuple[object, object]) -> bool:
    return all(one is other or one == other for one, other in pairs)
