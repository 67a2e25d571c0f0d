"""Finds doors and lids in a task: what the arm can change without touching an object of the workflow.

Each device is a small automaton over the atoms that its steps change together. Its settings are the states
that blocks of the plan need. A change of setting is a shortest path of steps.
"""

import heapq
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from cellwright.engine.model.shop import Changeover, Device, Need
from cellwright.engine.model.task import Bits, GroundOperator, Task, progress
from cellwright.engine.stages.scheduling.blocks import Block, Unstructured, atoms_about, touched
from cellwright.kb.terms import Term

MAX_STATES = 500  # that one device may have
FOUND = "as found"

Path = tuple[GroundOperator, ...]
Place = Callable[[GroundOperator], str]


@dataclass(frozen=True)
class Mechanism:
    """A device of the shop and what it means in the task: its `atoms`, and the steps of each change."""

    device: Device
    atoms: Bits
    settings: Mapping[Bits, str]  # the atoms that a block needs, and the setting that has them
    paths: Mapping[tuple[str, str], Path]

    def needs(self, block: Block) -> Iterator[Need]:
        """What a block needs of this device, as one interval or none. Raises `Unstructured`."""
        wanted = [
            (self.settings[step.preconditions & self.atoms], begin, end)
            for step, begin, end in block.timed
            if step.preconditions & self.atoms
        ]
        if len({setting for setting, _, _ in wanted}) > 1:
            raise Unstructured(f"one block needs two settings of {self.device.name}")
        if wanted:
            yield Need(self.device.name, wanted[0][0], wanted[0][1], wanted[-1][2])


def mechanisms(
    task: Task, arms: Sequence[Term], blocks: Sequence[Block], goals: Bits, place: Place
) -> tuple[Mechanism, ...]:
    """The devices that the blocks of a plan need.

    One arm alone changes each of them: the first that can. Raises `Unstructured`.
    """
    prepared = 0
    for step in (step for block in blocks if not block.serves for step in block.steps):
        if not any(arm in step.resources for arm in arms):
            raise Unstructured(f"{step.instance} serves no object of the workflow")
        prepared |= touched(step)
    every = atoms_about(task, *arms)
    found: list[Mechanism] = []
    for arm in arms:
        about = atoms_about(task, arm)
        able = [
            each
            for each in task.operators
            if arm in each.resources
            and not touched(each) & ~(prepared | every)
            and not (each.preconditions | each.adds) & every & ~about
        ]
        for atoms in _components([touched(each) & ~every for each in able]):
            if any(atoms & each.atoms for each in found):
                continue
            own = [each for each in able if touched(each) & atoms]
            name = _name(own, arm, [each.device.name for each in found])
            found.append(_Finder(task, atoms, about, own, place).mechanism(name, str(arm), blocks, goals))
    return tuple(found)


def _components(sets: Sequence[Bits]) -> list[Bits]:
    """Disjoint sets of atoms, the set with the lowest atom first.

    Atoms that one step touches are in one set.
    """
    found: list[Bits] = []
    for atoms in (each for each in sets if each):
        joined = atoms
        for other in [each for each in found if each & atoms]:
            joined |= other
            found.remove(other)
        found.append(joined)
    return sorted(found, key=lambda each: each & -each)


def _name(operators: Sequence[GroundOperator], arm: Term, taken: Sequence[str]) -> str:
    names = sorted({str(r) for each in operators for r in each.resources if r != arm})
    name = names[0] if names else operators[0].instance.name
    return name if name not in taken else f"{name} {len(taken) + 1}"


@dataclass(frozen=True)
class _Finder:
    task: Task
    atoms: Bits
    about: Bits  # the atoms about the arm
    operators: Sequence[GroundOperator]
    place: Place

    def mechanism(self, name: str, arm: str, blocks: Sequence[Block], goals: Bits) -> Mechanism:
        start = self.task.initial & (self.atoms | self.about)
        reached = self._from(start)
        home = self.task.initial & self.about
        modes = {state: found for state, found in reached.items() if state & self.about == home}
        wanted = self._wanted(name, blocks)
        final = goals & self.atoms
        chosen = _settings({*wanted, *([final] if final else [])}, modes)
        names = {mode: self._said([w for w, m in chosen.items() if m == mode]) for mode in chosen.values()}
        names.setdefault(start, FOUND)
        paths = {
            (names[one], names[other]): path
            for one in names
            for other, (_, path) in self._from(one).items()
            if other in names and other != one
        }
        changes = tuple(self._change(pair, path) for pair, path in paths.items())
        device = Device(name, arm, names[start], changes, names[chosen[final]] if final else "")
        return Mechanism(device, self.atoms, {each: names[mode] for each, mode in chosen.items()}, paths)

    def _wanted(self, name: str, blocks: Sequence[Block]) -> set[Bits]:
        """What blocks that serve an object need of these atoms.

        Raises `Unstructured` if such a block changes one of them.
        """
        serving = [block for block in blocks if block.serves]
        for block in serving:
            if any(bits & self.atoms for bits in (*block.ends, *block.makes)):
                raise Unstructured(f"{block.steps[0].instance} changes {name} by itself")
        needed = {step.preconditions & self.atoms for block in serving for step in block.steps}
        return needed - {0}

    def _from(self, start: Bits) -> dict[Bits, tuple[int, Path]]:
        """The states that can be reached, each with the time and the steps of a shortest path (Dijkstra)."""
        found: dict[Bits, tuple[int, Path]] = {}
        waiting: list[tuple[int, int, Bits, Path]] = [(0, 0, start, ())]
        count = 0
        while waiting:
            time, _, state, path = heapq.heappop(waiting)
            if state in found:
                continue
            found[state] = time, path
            if len(found) > MAX_STATES:
                raise Unstructured(f"a device has more than {MAX_STATES} states")
            for operator in self.operators:
                if operator.preconditions & ~state == 0:
                    count += 1
                    after = progress(state, operator) & (self.atoms | self.about)
                    heapq.heappush(waiting, (time + operator.duration, count, after, (*path, operator)))
        return found

    def _said(self, wanted: Sequence[Bits]) -> str:
        atoms = 0
        for each in wanted:
            atoms |= each
        return ", ".join(map(str, self.task.names(atoms)))

    def _change(self, pair: tuple[str, str], path: Path) -> Changeover:
        duration = sum(step.duration for step in path)
        return Changeover(*pair, duration, self.place(path[0]), self.place(path[-1]))


def _settings(wanted: set[Bits], modes: Mapping[Bits, tuple[int, Path]]) -> dict[Bits, Bits]:
    """The state that fulfils each need: as few states as possible, and those that are reached soonest."""
    chosen: dict[Bits, Bits] = {}
    fitting = {each: [mode for mode in modes if each & ~mode == 0] for each in wanted}
    for each in sorted(wanted, key=lambda w: (len(fitting[w]), w)):
        if not fitting[each]:
            raise Unstructured("a device needs a setting that the arm alone cannot reach")
        used = [mode for mode in fitting[each] if mode in chosen.values()]
        chosen[each] = used[0] if used else min(fitting[each], key=lambda mode: (modes[mode][0], mode))
    return chosen
