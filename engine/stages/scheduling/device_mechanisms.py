"""Finds doors and lids in a task: device settings that an arm changes by itself.

Each device is a small automaton over the atoms that its steps change together. Its settings are the
states that blocks of the plan need. A change of setting is a shortest path of steps.
"""

import heapq
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from cellwright.engine.kernels.bits import Bits
from cellwright.engine.model.ground_task import GroundOperator, GroundTask, progress_state
from cellwright.engine.model.shop_scheduling import Changeover, Need, ShopDevice
from cellwright.engine.stages.scheduling.plan_blocks import (
    Block,
    Unstructured,
    atoms_about,
    atoms_touched,
)
from cellwright.kb.terms import Term

MAX_STATES = 500  # that one device may have
INITIAL_SETTING = "as found"

ChangePath = tuple[GroundOperator, ...]
PlaceOfStep = Callable[[GroundOperator], str]


@dataclass(frozen=True)
class DeviceMechanism:
    """A device of the shop and what it means in the task: its `atoms`, and the steps of each
    change.
    """

    device: ShopDevice
    atoms: Bits
    settings: Mapping[Bits, str]  # the atoms that a block needs, and the setting that has them
    paths: Mapping[tuple[str, str], ChangePath]

    def needs(self, block: Block) -> Iterator[Need]:
        """What a block needs of this device, as one interval or none. Raises `Unstructured`."""
        wanted = [
            (self.settings[step.preconditions & self.atoms], begin, end)
            for step, begin, end in block.timed
            if step.preconditions & self.atoms
        ]
        if len({setting for setting, _, _ in wanted}) > 1:
            raise Unstructured(f"one errand of an arm needs two settings of {self.device.name}")
        if wanted:
            yield Need(self.device.name, wanted[0][0], wanted[0][1], wanted[-1][2])


def find_mechanisms(
    task: GroundTask, arms: Sequence[Term], blocks: Sequence[Block], goals: Bits, place: PlaceOfStep
) -> tuple[DeviceMechanism, ...]:
    """The devices that the blocks of a plan need.

    One arm alone changes each of them: the first that can. Raises `Unstructured`.
    """
    prepared = 0
    for step in (step for block in blocks if not block.serves for step in block.steps):
        if not any(arm in step.resources for arm in arms):
            raise Unstructured(f"{step.instance} serves no object of the workflow")
        prepared |= atoms_touched(step)
    every = atoms_about(task, *arms)
    mechanisms_found: list[DeviceMechanism] = []
    for arm in arms:
        about = atoms_about(task, arm)
        able = [
            candidate
            for candidate in task.operators
            if arm in candidate.resources
            and not atoms_touched(candidate) & ~(prepared | every)
            and not (candidate.preconditions | candidate.adds) & every & ~about
        ]
        for atoms in _disjoint_atoms(
            [atoms_touched(able_operator) & ~every for able_operator in able]
        ):
            if any(atoms & mechanism.atoms for mechanism in mechanisms_found):
                continue
            own = [able_operator for able_operator in able if atoms_touched(able_operator) & atoms]
            name = _mechanism_name(
                own, arm, [mechanism.device.name for mechanism in mechanisms_found]
            )
            mechanisms_found.append(
                _MechanismFinder(task, atoms, about, own, place).mechanism(
                    name, str(arm), blocks, goals
                )
            )
    return tuple(mechanisms_found)


def _disjoint_atoms(sets: Sequence[Bits]) -> list[Bits]:
    """Disjoint sets of atoms, the set with the lowest atom first.

    Atoms that one step touches are in one set.
    """
    components: list[Bits] = []
    for atoms in (atom_set for atom_set in sets if atom_set):
        joined = atoms
        for other in [component for component in components if component & atoms]:
            joined |= other
            components.remove(other)
        components.append(joined)
    return sorted(components, key=lambda component: component & -component)


def _mechanism_name(operators: Sequence[GroundOperator], arm: Term, taken: Sequence[str]) -> str:
    names = sorted({str(r) for operator in operators for r in operator.resources if r != arm})
    name = names[0] if names else operators[0].instance.name
    return name if name not in taken else f"{name} {len(taken) + 1}"


@dataclass(frozen=True)
class _MechanismFinder:
    task: GroundTask
    atoms: Bits
    about: Bits  # the atoms about the arm
    operators: Sequence[GroundOperator]
    place: PlaceOfStep

    def mechanism(
        self, name: str, arm: str, blocks: Sequence[Block], goals: Bits
    ) -> DeviceMechanism:
        start = self.task.initial & (self.atoms | self.about)
        reached = self._from(start)
        home = self.task.initial & self.about
        modes = {
            state: cost_and_path
            for state, cost_and_path in reached.items()
            if state & self.about == home
        }
        wanted = self._wanted(name, blocks)
        final = goals & self.atoms
        chosen = _choose_settings({*wanted, *([final] if final else [])}, modes)
        names = {
            mode: self._said([w for w, m in chosen.items() if m == mode])
            for mode in chosen.values()
        }
        names.setdefault(start, INITIAL_SETTING)
        paths = {
            (names[before], names[after]): path
            for before in names
            for after, (_, path) in self._from(before).items()
            if after in names and after != before
        }
        changes = tuple(self._change(pair, path) for pair, path in paths.items())
        device = ShopDevice(name, arm, names[start], changes, names[chosen[final]] if final else "")
        return DeviceMechanism(
            device,
            self.atoms,
            {need_atoms: names[mode] for need_atoms, mode in chosen.items()},
            paths,
        )

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

    def _from(self, start: Bits) -> dict[Bits, tuple[int, ChangePath]]:
        """The states that can be reached, each with the time and the steps of a shortest path
        (Dijkstra).
        """
        reached_states: dict[Bits, tuple[int, ChangePath]] = {}
        waiting: list[tuple[int, int, Bits, ChangePath]] = [(0, 0, start, ())]
        count = 0
        while waiting:
            time, _, state, path = heapq.heappop(waiting)
            if state in reached_states:
                continue
            reached_states[state] = time, path
            if len(reached_states) > MAX_STATES:
                raise Unstructured(f"a device has more than {MAX_STATES} states")
            for operator in self.operators:
                if operator.preconditions & ~state == 0:
                    count += 1
                    after = progress_state(state, operator) & (self.atoms | self.about)
                    heapq.heappush(
                        waiting, (time + operator.duration, count, after, (*path, operator))
                    )
        return reached_states

    def _said(self, wanted: Sequence[Bits]) -> str:
        atoms = 0
        for need_atoms in wanted:
            atoms |= need_atoms
        return ", ".join(map(str, self.task.names(atoms)))

    def _change(self, pair: tuple[str, str], path: ChangePath) -> Changeover:
        duration = sum(step.duration for step in path)
        return Changeover(*pair, duration, self.place(path[0]), self.place(path[-1]))


def _choose_settings(
    wanted: set[Bits], modes: Mapping[Bits, tuple[int, ChangePath]]
) -> dict[Bits, Bits]:
    """The state that fulfils each need: as few states as possible, and those that are reached
    soonest.
    """
    chosen: dict[Bits, Bits] = {}
    fitting = {needed: [mode for mode in modes if needed & ~mode == 0] for needed in wanted}
    for need_atoms in sorted(wanted, key=lambda w: (len(fitting[w]), w)):
        if not fitting[need_atoms]:
            raise Unstructured("a device needs a setting that the arm alone cannot reach")
        used = [mode for mode in fitting[need_atoms] if mode in chosen.values()]
        chosen[need_atoms] = (
            used[0] if used else min(fitting[need_atoms], key=lambda mode: (modes[mode][0], mode))
        )
    return chosen
