"""Landmarks of the delete relaxation: facts, sets of facts, their orders, how many are to come."""

from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

from cellwright.engine.kernels.bits import Bits, indices
from cellwright.engine.kernels.packed_rows import PackedRows
from cellwright.engine.model.ground_task import GroundOperator, GroundTask
from cellwright.engine.stages.planning.forward.kernels import LandmarkCount
from cellwright.kb.terms import Atom, Function


class Achievers:
    """The achievers of atoms.

    `landmarks` has the landmarks of each atom, itself included; None for one that cannot be
    reached.
    """

    def __init__(
        self, operators: Sequence[GroundOperator], landmarks: Sequence[Bits | None]
    ) -> None:
        self.landmarks, self._operators = landmarks, operators
        self._adding: list[list[int]] = [[] for _ in landmarks]
        for number, operator in enumerate(operators):
            for atom in indices(operator.adds):
                self._adding[atom].append(number)

    def of(self, atoms: Bits) -> Iterator[GroundOperator]:
        """The operators that can make one of some atoms true."""
        for number in dict.fromkeys(
            number for atom in indices(atoms) for number in self._adding[atom]
        ):
            if self.needed(self._operators[number]) is not None:
                yield self._operators[number]

    def first(self, atoms: Bits) -> Iterator[GroundOperator]:
        """Those that can do it before any of the atoms was true."""
        single = atoms & (atoms - 1) == 0
        for operator in self.of(atoms):
            before = self.needed(operator) if single else operator.preconditions
            if not atoms & (before or 0):
                yield operator

    def needed(self, operator: GroundOperator) -> Bits | None:
        """The landmarks of what an operator needs; None if it can never be applied."""
        needed_landmarks = 0
        for atom in indices(operator.preconditions):
            own = self.landmarks[atom]
            if own is None:
                return None
            needed_landmarks |= own
        return needed_landmarks


MAX_SET_ATOMS = 100  # atoms in a set
MAX_DISJUNCTIONS = 2_000  # sets


def predicate_kinds(atoms: Sequence[Atom]) -> list[int]:
    """A number for the predicate of each atom; complements have another one."""
    numbers: dict[tuple[str, ...], int] = {}
    return [numbers.setdefault(_predicate_kind(atom), len(numbers)) for atom in atoms]


def _predicate_kind(atom: Atom) -> tuple[str, ...]:
    inner = atom.arguments[0] if atom.name == "not" and len(atom.arguments) == 1 else None
    return ("not", inner.name) if isinstance(inner, Function) else (atom.name,)


class Disjunctions:
    """The sets of atoms that come before some landmarks. Set n has the number `first` + n, behind
    those of all atoms.

    `orders` are pairs of a set and what it comes just before: a landmark, or another set. Only
    atoms with one of the `kinds` are in sets.
    """

    def __init__(
        self, achievers: Achievers, landmarks: Bits, said_nothing: Bits, kinds: Sequence[int]
    ) -> None:
        self._achievers, self._kinds = achievers, kinds
        self._trivial = landmarks | said_nothing
        self.first = len(achievers.landmarks)
        self.sets: list[Bits] = []
        self.orders: list[tuple[int, int]] = []
        waiting = deque((1 << atom, atom) for atom in indices(landmarks & ~said_nothing))
        numbers: dict[Bits, int] = {}
        while waiting:
            atoms, later = waiting.popleft()
            for earlier in self._just_before(atoms):
                if earlier not in numbers and len(numbers) < MAX_DISJUNCTIONS:
                    numbers[earlier] = self.first + len(self.sets)
                    self.sets.append(earlier)
                    waiting.append((earlier, numbers[earlier]))
                if numbers.get(earlier, later) != later:
                    self.orders.append((numbers[earlier], later))

    def _just_before(self, atoms: Bits) -> Iterator[Bits]:
        """The sets of atoms of one predicate, one of which every operator needs that can reach
        some atoms first.
        """
        shared: dict[int, Bits] | None = None
        for operator in self._achievers.first(atoms):
            own = self._by_kind(operator.preconditions)
            common = own if shared is None else shared
            shared = {kind: mask | own[kind] for kind, mask in common.items() if kind in own}
            if not shared:
                return
        for disjunction in (shared or {}).values():
            if 2 <= disjunction.bit_count() <= MAX_SET_ATOMS and not disjunction & self._trivial:
                yield disjunction

    def _by_kind(self, atoms: Bits) -> dict[int, Bits]:
        atoms_by_kind: dict[int, Bits] = {}
        for atom in indices(atoms):
            if atom < len(self._kinds):
                atoms_by_kind[self._kinds[atom]] = (
                    atoms_by_kind.get(self._kinds[atom], 0) | 1 << atom
                )
        return atoms_by_kind


class ReachingMoment(NamedTuple):
    """What is known of the moment in which a landmark is reached first, or again if it is true from
    the start.

    `needed` are atoms that are true just before, `together` those that are true then.
    """

    needed: Bits
    together: Bits


def reaching_moments(
    achievers: Achievers, initial: Bits, landmarks: Bits
) -> dict[int, ReachingMoment]:
    """What all operators share that can reach a landmark first, or again if it is true from the
    start.
    """
    moments = {}
    for atom in indices(landmarks):
        needed = together = -1
        for operator in (
            achievers.of(1 << atom) if initial >> atom & 1 else achievers.first(1 << atom)
        ):
            needed &= operator.preconditions
            together &= operator.adds | operator.preconditions & ~operator.deletes
        moments[atom] = (
            ReachingMoment(needed, together) if needed >= 0 else ReachingMoment(0, 1 << atom)
        )
    return moments


def reasonable_orders(
    goals: Bits,
    before: Mapping[int, Bits],
    moments: Mapping[int, ReachingMoment],
    groups: Sequence[Bits],
) -> dict[int, Bits]:
    """For each landmark those that shall be reached before it. `before` has those that must."""
    orders = dict(before)
    for later, earlier in interfering_pairs(goals, moments, groups):
        add_order(orders, earlier, later)
    return orders


def interfering_pairs(
    goals: Bits, moments: Mapping[int, ReachingMoment], groups: Sequence[Bits]
) -> Iterator[tuple[int, int]]:
    """Pairs of a goal and a landmark for which the goal has to be given up; first those of two
    goals.
    """
    excluded = _mutex_partners(groups)
    conflicts = {}
    for atom, moment in moments.items():
        conflicts[atom] = 0
        for rival in indices(moment.needed | moment.together):
            conflicts[atom] |= excluded.get(rival, 0)
    for earlier in sorted(moments, key=lambda landmark: not goals >> landmark & 1):
        for later in indices(conflicts[earlier] & goals & ~(1 << earlier)):
            yield later, earlier


def _mutex_partners(groups: Sequence[Bits]) -> dict[int, Bits]:
    """For each atom those that are never true with it."""
    partners: dict[int, Bits] = {}
    for group in groups:
        for atom in indices(group):
            partners[atom] = partners.get(atom, 0) | group & ~(1 << atom)
    return partners


def add_order(orders: dict[int, Bits], earlier: int, later: int) -> None:
    """One more order, and those that follow from it; nothing if it is known, or would close a
    circle.
    """
    if (orders[earlier] >> later | orders[later] >> earlier) & 1:
        return
    more = orders[earlier] | 1 << earlier
    for landmark, predecessors in orders.items():
        if landmark == later or predecessors >> later & 1:
            orders[landmark] = predecessors | more


MAX_FIXPOINT_VISITS = 3_000_000  # visits of operators that the fixpoint may take


class LandmarkHints(NamedTuple):
    """What finds landmarks and their orders beside operators: mutex groups, and a number for
    the predicate of each atom.
    """

    groups: Sequence[Bits] = ()
    kinds: Sequence[int] = ()

    @classmethod
    def of(cls, task: GroundTask) -> "LandmarkHints":
        """Those of a task."""
        return cls(task.mutex_groups, predicate_kinds(task.atoms))


class Landmarks:
    """The landmarks of a conjunction of goals: `all` is the set of atoms that are landmarks, `sets`
    the sets of atoms of which one is. `before` are those that shall be reached before each, and
    `moments` what is known of reaching an atom. A set has a number behind those of all atoms.

    If it takes too much work to find them, only the goals are landmarks. No atom is `hidden`.
    Accepted landmarks are a row of bytes, as in `LandmarkCount`.
    """

    def __init__(
        self,
        operators: Sequence[GroundOperator],
        initial: Bits,
        goals: Bits,
        size: int,
        hidden: Bits = 0,
        hints: LandmarkHints = LandmarkHints(),
    ) -> None:
        self.operators, self.initial, self.goals, self.size = operators, initial, goals, size
        before = self._fixpoint()
        self.all = goals
        for goal in indices(goals):
            self.all |= before[goal] or 0
        self.all &= ~hidden
        achievers = Achievers(operators, before)
        self.moments = reaching_moments(achievers, initial, self.all)
        disjunctions = Disjunctions(achievers, self.all, initial, hints.kinds)
        self.sets = disjunctions.sets
        self.before = reasonable_orders(
            goals, self._must(achievers, disjunctions), self.moments, hints.groups
        )
        self._count = self._numbered()
        self.none = bytes((len(self.before) + 7) // 8)

    def _must(self, achievers: Achievers, disjunctions: Disjunctions) -> dict[int, Bits]:
        """For each landmark those that are reached before it on every way. What is true from the
        start comes before nothing, unless it has to be reached again."""
        ahead = self.all & ~self.initial
        before = {
            atom: (achievers.landmarks[atom] or 0) & ahead & ~(1 << atom) for atom in self.moments
        }
        for number, atoms in enumerate(disjunctions.sets, disjunctions.first):
            shared = ahead
            for operator in achievers.first(atoms):
                shared &= achievers.needed(operator) or 0
            before[number] = shared
        for earlier, later in disjunctions.orders:
            add_order(before, earlier, later)
        return before

    def _numbered(self) -> LandmarkCount:
        """The compiled kernel that counts.

        It numbers the landmarks in the order of their atoms, then the sets.
        """
        number = {landmark: place for place, landmark in enumerate(self.before)}
        needed = [
            *(moment.needed & self.all for moment in self.moments.values()),
            *(0 for _ in self.sets),
        ]

        def rows(sets: Iterable[Bits]) -> PackedRows:
            return PackedRows([[number[atom] for atom in indices(own)] for own in sets])

        atoms = PackedRows([*([atom] for atom in self.moments), *map(indices, self.sets)])
        goals = [number[goal] for goal in indices(self.goals)]
        return LandmarkCount(atoms, rows(self.before.values()), rows(needed), goals)

    def _fixpoint(self) -> list[Bits | None]:
        """For each atom its landmarks, itself included; None if the atom is unreachable.

        If the fixpoint takes too much work, each atom has only itself as a landmark.
        """
        atom_landmarks: list[Bits | None] = [
            1 << atom if self.initial >> atom & 1 else None for atom in range(self.size)
        ]
        users: list[list[int]] = [[] for _ in range(self.size)]
        for number, operator in enumerate(self.operators):
            for atom in indices(operator.preconditions):
                users[atom].append(number)
        waiting = list(range(len(self.operators)))
        work = 0
        while waiting and work < MAX_FIXPOINT_VISITS:
            touched: dict[int, None] = {}
            for number in waiting:
                self._look(self.operators[number], atom_landmarks, touched)
            work += len(waiting)
            waiting = list(dict.fromkeys(number for atom in touched for number in users[atom]))
        return atom_landmarks if not waiting else [1 << atom for atom in range(self.size)]

    def _look(
        self, operator: GroundOperator, atom_landmarks: list[Bits | None], touched: dict[int, None]
    ) -> None:
        """Keeps, for each atom that an operator adds, only the landmarks that all achievers so far
        share.

        Atoms whose landmarks change are noted in `touched`.
        """
        needed = 0
        for atom in indices(operator.preconditions):
            landmarks = atom_landmarks[atom]
            if landmarks is None:
                return
            needed |= landmarks
        for atom in indices(operator.adds):
            earlier_set = atom_landmarks[atom]
            shared = (
                needed | 1 << atom if earlier_set is None else earlier_set & (needed | 1 << atom)
            )
            if shared != earlier_set:
                atom_landmarks[atom] = shared
                touched[atom] = None

    def accept(self, accepted: bytes, state: bytes) -> bytes:
        """The accepted landmarks after one more packed state."""
        return self._count.accept(accepted, state)

    def left(self, accepted: bytes, state: bytes) -> int:
        """The number of landmarks that are still to be visited, or to be visited again."""
        return self._count.left(accepted, state)
