"""Is a thinned task as good as the whole one: does every plan of the whole have one here that is no longer?

Read every object of a class of alike ones as the first of its spares. If each step of the thinned task, read so, is again
a step that needs no more, achieves as much and destroys nothing that could still be there, every plan of the whole can be
read as one of the thinned task. The spares are as many as one step and its consequences can name, and one more, so what
holds of them holds of all objects of their class.
"""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from cellwright.engine.model.task import Bits, GroundOperator, Task, bitset, indices
from cellwright.kb.terms import Atom, Function, Term, exchanged


def without_irrelevant(task: Task) -> Task:
    """The task without operators that contribute to no goal, whatever else is done."""
    wanted = 0
    for goal in task.goals:
        wanted |= goal
    waiting: list[GroundOperator] = list(task.operators)
    if task.axioms is not None:
        wanted |= task.axioms.read

    def achieves(operator: GroundOperator) -> Bits:
        return _achieves(operator) | (task.axioms.helps(operator.changes) if task.axioms else 0)

    grown = True
    while grown:
        grown, rest = False, []
        for operator in waiting:
            if achieves(operator) & wanted:
                more = _needs(operator) & ~wanted
                wanted, grown = wanted | more, grown or bool(more)
            else:
                rest.append(operator)
        waiting = rest
    kept = tuple(each for each in task.operators if achieves(each) & wanted)
    return replace(task, operators=kept)


def _achieves(operator: GroundOperator) -> Bits:
    adds = operator.adds
    for effect in operator.conditional:
        adds |= effect.adds
    return adds


def _needs(operator: GroundOperator) -> Bits:
    needs = operator.preconditions
    for effect in operator.conditional:
        needs |= effect.condition
    return needs


def faithful(task: Task, spares: Sequence[tuple[str, ...]]) -> bool:
    """Whether the shortest plans of a thinned task are as short as those of the whole one, and exist where they exist."""
    if task.axioms is not None or any(operator.conditional for operator in task.operators):
        return False
    return all(_Reading(task, own).fits() for own in spares if len(own) > 1)


@dataclass
class _Reading:
    """A task in which every spare object is read as the first one."""

    task: Task
    spares: tuple[str, ...]

    def fits(self) -> bool:
        """Whether every step can be read so."""
        task = self.task
        start = all(
            task.initial >> self.image[n] & 1
            for n in indices(task.initial & self.relevant)
            if n in self.image
        )
        whole = all(n in self.image for n in indices(self.relevant))
        return whole and start and self._goals() and all(map(self._readable, task.operators))

    def _goals(self) -> bool:
        return all(any(goal & ~self._read(each) == 0 for goal in self.task.goals) for each in self.task.goals)

    @cached_property
    def relevant(self) -> Bits:
        """The atoms that goals and steps need."""
        found = 0
        for goal in self.task.goals:
            found |= goal
        for operator in self.task.operators:
            found |= operator.preconditions
        return found

    @cached_property
    def image(self) -> dict[int, int]:
        """For each atom the one that it is read as, if there is such an atom."""
        index = {atom: number for number, atom in enumerate(self.task.atoms)}
        pairs = ((n, index.get(self._renamed(atom))) for n, atom in enumerate(self.task.atoms))
        return {number: found for number, found in pairs if found is not None}

    @cached_property
    def sources(self) -> Mapping[int, list[int]]:
        """For each atom those that are read as it."""
        found: dict[int, list[int]] = defaultdict(list)
        for number, image in self.image.items():
            found[image].append(number)
        return found

    @cached_property
    def by_instance(self) -> Mapping[Function, list[GroundOperator]]:
        found: dict[Function, list[GroundOperator]] = defaultdict(list)
        for operator in self.task.operators:
            found[operator.instance].append(operator)
        return found

    @cached_property
    def exclusive(self) -> Mapping[int, Bits]:
        """For each atom those that are never true together with it."""
        found: dict[int, Bits] = defaultdict(int)
        for group in self.task.mutex_groups:
            for number in indices(group):
                found[number] |= group & ~(1 << number)
        return found

    @cached_property
    def first(self) -> Mapping[Term, Term]:
        """The first spare in the place of each other one."""
        return {Function(name): Function(self.spares[0]) for name in self.spares[1:]}

    def _renamed(self, atom: Atom) -> Atom:
        return Function(atom.name, tuple(exchanged(each, self.first) for each in atom.arguments))

    def _read(self, atoms: Bits) -> Bits:
        return bitset([self.image[n] for n in indices(atoms) if n in self.image])

    def _readable(self, operator: GroundOperator) -> bool:
        """Whether a step, read so, is a step that serves as well; or changes nothing that matters."""
        adds = self._read(operator.adds & self.relevant)
        needs = self._read(operator.preconditions)
        if adds & ~needs == 0:
            return True
        return any(
            each.preconditions & ~needs == 0
            and adds & ~(each.adds | needs & ~each.deletes) == 0
            and each.cost <= operator.cost
            and not any(self._lost(operator, each))
            for each in self.by_instance.get(self._renamed(operator.instance), ())
        )

    def _lost(self, operator: GroundOperator, image: GroundOperator) -> Iterator[bool]:
        """For each atom that the image ends: whether a step leaves one that is read as it."""
        for ended in indices(image.deletes & ~image.adds & self.relevant):
            for source in self.sources.get(ended, ()):
                changed = (operator.deletes | operator.adds) >> source & 1
                yield not changed and not self.exclusive.get(source, 0) & operator.preconditions
