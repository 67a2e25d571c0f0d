"""Turns a task-level plan into a shop: objects of the workflow become jobs, blocks become stages.

These orders are kept: those within each object, causal links between objects, and all others between changes
that two objects make to the same atom. Orders that only say which object came first (at the arm, at places,
at devices) are dropped.
"""

import itertools
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

from cellwright.engine.model.shop import Hold, Job, Resource, Shop, Stage, Window, in_order
from cellwright.engine.model.task import Bits, GroundOperator, Task, bitset, indices
from cellwright.engine.stages.scheduling.blocks import Block, arms_of, atoms_about, cut, mentions
from cellwright.engine.stages.scheduling.detours import necessary, straightened
from cellwright.engine.stages.scheduling.places import Exchange, Touch, holds_of
from cellwright.engine.stages.scheduling.settings import Mechanism, mechanisms
from cellwright.kb.terms import Function, Term, natural_key

REST = "other work"  # the job of the blocks that serve no object


@dataclass(frozen=True)
class Wishes:
    """What a cell says about time besides durations: empty travel between stops, longest stays in places, when jobs begin
    and are due, and in which windows measurements begin, by their names, counted from the start of the tour. A tour that is
    `under_way` began before: its windows count from the start of the plan.
    """

    travel: Mapping[tuple[Term, Term], int] = field(default_factory=dict)
    stops: frozenset[Term] = frozenset()
    longest_stay: Mapping[Term, int] = field(default_factory=dict)
    release: Mapping[Term, int] = field(default_factory=dict)
    due: Mapping[Term, int] = field(default_factory=dict)
    priority: Mapping[Term, int] = field(default_factory=dict)
    windows: Mapping[str, tuple[int, int]] = field(default_factory=dict)
    under_way: bool = False

    @property
    def any(self) -> bool:
        """Whether anything is wished."""
        return any((self.travel, self.longest_stay, self.release, self.due, self.windows))

    def place(self, instance: Function, resources: Sequence[Term], *arms: Term) -> Term | None:
        """Where a step is done: the first of its terms that is a stop."""
        terms = (*instance.arguments, *(each for each in resources if each not in arms))
        return next((term for term in terms if term in self.stops), None)


@dataclass(frozen=True)
class PlaceVisit:
    """An object takes `place`, by a hold of a resource that has several equal places."""

    hold: Hold
    place: Term
    stages: tuple[str, ...]  # from the stage that takes the place to the stage that leaves it


@dataclass(frozen=True)
class CellWork:
    """A shop, and what its stages, device changes and holds mean in the task."""

    shop: Shop
    blocks: Mapping[str, Block]
    mechanisms: Mapping[str, Mechanism]
    visits: Mapping[str, tuple[PlaceVisit, ...]]  # by resource
    places: Mapping[str, tuple[Term, ...]]  # the equal places of each of these resources


def cell_work(
    task: Task,
    steps: Sequence[GroundOperator],
    goals: Bits,
    subjects: Sequence[Term],
    wishes: Wishes = Wishes(),
) -> CellWork:
    """The shop of a plan; `steps` are plain operators in an executable order. Raises `Unstructured`."""
    return _Assembly(task, tuple(steps), goals, tuple(subjects), wishes).work()


@dataclass(frozen=True)
class _Assembly:
    task: Task
    steps: tuple[GroundOperator, ...]
    goals: Bits
    subjects: tuple[Term, ...]
    wishes: Wishes

    def work(self) -> CellWork:
        holds: list[Hold] = []
        visits: dict[str, tuple[PlaceVisit, ...]] = {}
        places: dict[str, tuple[Term, ...]] = {}
        windows = [window for job in self.jobs for window in in_order(job.stages)]
        for group, found in self._pools():
            name = str(group[0].arguments[0]) if group[0].arguments else str(group[0])
            held = [Hold(name, hold.begin, hold.end) for _, hold in found]
            if len({self._owner(hold) for hold in held}) > 1:
                holds += held
                places[name] = tuple(atom.arguments[0] for atom in group if atom.arguments)
                visits[name] = tuple(self._visits(name, found))
            windows += [w for atom, hold in found for w in self._stay(atom, hold)]
        holds += self._shared_resources(tuple(places.values()))
        windows += self._links()
        resources = [
            *map(self._arm_resource, self.arms),
            *(self._resource(each, places) for each in _resources(holds)),
        ]
        devices = tuple(each.device for each in self.mechanisms)
        shop = Shop(self.jobs, tuple(resources), tuple(dict.fromkeys(windows)), tuple(holds), devices)
        known = {each.device.name: each for each in self.mechanisms}
        return CellWork(shop, self.named, known, visits, places)

    @cached_property
    def arms(self) -> tuple[Term, ...]:
        return arms_of(self.steps, self.subjects)

    @cached_property
    def cut(self) -> tuple[Block, ...]:
        """The blocks of the plan in its order, without those that are not necessary."""
        blocks = cut(self.task, self.steps, self.arms, self.subjects)
        return tuple(necessary(self.task, blocks, self.goals))

    @cached_property
    def named(self) -> dict[str, Block]:
        """The blocks that serve an object or a stage, without detours, by the name of the stage they become."""
        places = bitset(list(self._held(self._touches(_named(self.cut)))))
        return _named(straightened(self.cut, places | atoms_about(self.task, *self.arms)))

    @cached_property
    def mechanisms(self) -> tuple[Mechanism, ...]:
        return mechanisms(self.task, self.arms, self.cut, self.goals, self._place)

    def _place(self, step: GroundOperator) -> str:
        found = self.wishes.place(step.instance, step.resources, *self.arms)
        return "" if found is None else str(found)

    @cached_property
    def jobs(self) -> tuple[Job, ...]:
        found: dict[Term | None, list[Stage]] = {}
        for name, block in self.named.items():
            needs = tuple(need for each in self.mechanisms for need in each.needs(block))
            ends = (self._place(block.steps[0]), self._place(block.steps[-1])) if block.arms else ("", "")
            stage = Stage(name, block.duration, tuple(map(str, block.arms)), needs, *ends)
            found.setdefault(block.subject, []).append(stage)
        ordered = [each for each in (*self.subjects, None) if each in found]
        return tuple(self._job(subject, tuple(found[subject])) for subject in ordered)

    def _job(self, subject: Term | None, stages: tuple[Stage, ...]) -> Job:
        if subject is None:
            return Job(REST, stages)
        wishes = self.wishes
        times = wishes.release.get(subject, 0), wishes.due.get(subject), wishes.priority.get(subject, 1)
        return Job(str(subject), stages, *times)

    @cached_property
    def touches(self) -> dict[int, list[Touch]]:
        """What stages do to each atom, in the order of the plan.

        Atoms of the arm and of devices are left out.
        """
        return self._touches(self.named)

    def _touches(self, named: Mapping[str, Block]) -> dict[int, list[Touch]]:
        private = atoms_about(self.task, *self.arms)
        for each in self.mechanisms:
            private |= each.atoms
        found: dict[int, list[Touch]] = defaultdict(list)
        for name, block in named.items():
            for (step, begin, end), ends, makes in zip(block.timed, block.ends, block.makes, strict=True):
                for atom in indices((step.preconditions | ends | makes) & ~private):
                    does = (bool(bits >> atom & 1) for bits in (step.preconditions, ends, makes))
                    found[atom].append(Touch(name, str(block.subject), begin, end, *does))
        return found

    @cached_property
    def held(self) -> dict[Function, list[Hold]]:
        """The atoms that say that a place is free, with the holds of this place."""
        return {self.task.atoms[number]: holds for number, holds in self._held(self.touches).items()}

    def _held(self, touches: Mapping[int, Sequence[Touch]]) -> dict[int, list[Hold]]:
        found: dict[int, list[Hold]] = {}
        for number, each in touches.items():
            if any(touch.ends for touch in each) and any(touch.makes for touch in each):
                holds = holds_of("", each, bool(self.task.initial >> number & 1))
                if holds is not None:
                    found[number] = holds
        return found

    def _pools(self) -> Iterator[tuple[tuple[Function, ...], list[tuple[Function, Hold]]]]:
        """Groups of atoms whose places can be exchanged, with all holds of these places."""
        exchange = Exchange(self.task, self.goals)
        done: set[Function] = set()
        for atom in self.held:
            if atom not in done:
                group = exchange.alike(atom)
                done |= set(group)
                yield group, [(each, hold) for each in group for hold in self.held.get(each, [])]

    def _owner(self, hold: Hold) -> Term | None:
        moment = hold.begin or hold.end
        return self.named[moment.stage].subject if moment else None

    def _visits(self, name: str, found: Sequence[tuple[Function, Hold]]) -> Iterator[PlaceVisit]:
        for atom, hold in found:
            if atom.arguments:
                yield PlaceVisit(Hold(name, hold.begin, hold.end), atom.arguments[0], self._between(hold))

    def _between(self, hold: Hold) -> tuple[str, ...]:
        """The stages of the object from the one that takes the place to the one that leaves it."""
        own = [name for name, block in self.named.items() if block.subject == self._owner(hold)]
        first = own.index(hold.begin.stage) if hold.begin else 0
        last = own.index(hold.end.stage) if hold.end else len(own) - 1
        return tuple(own[first : last + 1])

    def _stay(self, atom: Function, hold: Hold) -> Iterator[Window]:
        """Windows for the longest stay in a place.

        They go from the end of the step that brings an object to the start of the step that takes it.
        """
        for place, most in self.wishes.longest_stay.items():
            if mentions(atom, place) and hold.begin and hold.end and hold.begin.stage != hold.end.stage:
                came = next(t for t in self._at(atom) if t.first == hold.begin)
                left = next(t for t in self._at(atom) if t.last == hold.end)
                yield Window(came.last, left.first, 0, most)

    def _at(self, atom: Function) -> list[Touch]:
        return self.touches[self.task.atoms.index(atom)]

    def _shared_resources(self, pools: Sequence[tuple[Term, ...]]) -> Iterator[Hold]:
        """Holds of other resources that steps of several objects use, if no place keeps these steps apart."""
        kept = {*self.arms, *self.subjects, *itertools.chain(*pools)}
        users: dict[Term, list[Touch]] = defaultdict(list)
        for name, block in self.named.items():
            for step, begin, end in block.timed:
                for resource in (each for each in step.resources if each not in kept):
                    users[resource].append(Touch(name, str(block.subject), begin, end, True, False, False))
        for resource, touches in users.items():
            if len({touch.job for touch in touches}) > 1:
                yield from (Hold(str(resource), touch.first, touch.last) for touch in touches)

    def _links(self) -> Iterator[Window]:
        """Windows that keep the plan's order between objects that change the same atom, unless it is about a
        place.
        """
        for number, touches in self.touches.items():
            if self.task.atoms[number] in self.held:
                continue
            for one, other in itertools.combinations(touches, 2):
                changes = one.ends or one.makes or other.ends or other.makes
                if one.job != other.job and changes:
                    yield Window(one.last, other.first)

    def _arm_resource(self, arm: Term) -> Resource:
        travel = {(str(a), str(b)): lasts for (a, b), lasts in self.wishes.travel.items()}
        return Resource(str(arm), 1, travel)

    def _resource(self, name: str, places: Mapping[str, tuple[Term, ...]]) -> Resource:
        units = tuple(map(str, sorted(places.get(name, ()), key=natural_key)))
        return Resource(name, max(1, len(units)), units=units)


def _named(blocks: Sequence[Block]) -> dict[str, Block]:
    """The blocks that serve an object or a stage, by the name of the stage they become."""
    found: dict[str, Block] = {}
    numbers: dict[Term | None, Iterator[int]] = defaultdict(lambda: itertools.count(1))
    for block in (each for each in blocks if each.serves):
        said = " ".join(dict.fromkeys(step.instance.name for step in block.steps))
        owner = block.subject if block.subject is not None else REST
        found[f"{owner} {next(numbers[block.subject])} {said}"] = block
    return found


def _resources(holds: Sequence[Hold]) -> list[str]:
    return list(dict.fromkeys(hold.resource for hold in holds))
