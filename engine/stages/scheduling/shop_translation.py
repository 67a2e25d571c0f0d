"""Turns a task-level plan into a shop, and a schedule of it back into timed steps.

These orders are kept: those within each object, causal links between objects, and all others
between changes that two objects make to the same atom. Orders that only say which object came first
(at the arm, at places, at devices) are dropped.
"""

import itertools
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

from cellwright.engine.kernels.bits import Bits, bitset, indices
from cellwright.engine.model.ground_task import GroundOperator, GroundTask, progress_state
from cellwright.engine.model.shop_scheduling import (
    Hold,
    Resource,
    Schedule,
    Shop,
    ShopJob,
    ShopStage,
    StageMoment,
    StageWindow,
    chain_windows,
)
from cellwright.engine.model.workflow_replay import STAGE_FLUENT
from cellwright.engine.stages.scheduling.device_mechanisms import DeviceMechanism, find_mechanisms
from cellwright.engine.stages.scheduling.place_holds import AtomTouch, Exchange, place_holds_of
from cellwright.engine.stages.scheduling.plan_blocks import (
    Block,
    Unstructured,
    arm_resources,
    atoms_about,
    contains_term,
    cut_blocks,
    necessary_blocks,
    remove_detours,
)
from cellwright.engine.stages.scheduling.window_lags import StepLag
from cellwright.kb.model.time_windows import TimeOfWork, TimeWindow
from cellwright.kb.terms import Function, Term, exchange_subterms, natural_key

OTHER_WORK_JOB = "other work"  # the job of the blocks that serve no object


@dataclass(frozen=True)
class Wishes:
    """What a cell says about time besides durations: empty travel between stops, longest stays in
    places, when jobs begin and are due, and in which windows measurements begin, by their names,
    counted from the start of the tour. A tour that is `under_way` began before: its windows count
    from the start of the plan. `between` are windows between two events of the plan, `calendars`
    say when steps may be done.
    """

    travel: Mapping[tuple[Term, Term], int] = field(default_factory=dict)
    stops: frozenset[Term] = frozenset()
    longest_stay: Mapping[Term, int] = field(default_factory=dict)
    release: Mapping[Term, int] = field(default_factory=dict)
    due: Mapping[Term, int] = field(default_factory=dict)
    priority: Mapping[Term, int] = field(default_factory=dict)
    windows: Mapping[str, tuple[int, int]] = field(default_factory=dict)
    under_way: bool = False
    between: tuple[TimeWindow, ...] = ()
    calendars: tuple[TimeOfWork, ...] = ()

    @property
    def any(self) -> bool:
        """Whether anything is wished."""
        asked = self.travel, self.longest_stay, self.release, self.due, self.windows
        return any((*asked, self.between, self.calendars))

    def place(self, instance: Function, resources: Sequence[Term], *arms: Term) -> Term | None:
        """Where a step is done: the first of its terms that is a stop."""
        terms = (*instance.arguments, *(resource for resource in resources if resource not in arms))
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
    mechanisms: Mapping[str, DeviceMechanism]
    visits: Mapping[str, tuple[PlaceVisit, ...]]  # by resource
    places: Mapping[str, tuple[Term, ...]]  # the equal places of each of these resources


def cell_work(
    task: GroundTask,
    steps: Sequence[GroundOperator],
    goals: Bits,
    subjects: Sequence[Term],
    wishes: Wishes = Wishes(),
    lags: Sequence[StepLag] = (),
) -> CellWork:
    """The shop of a plan; `steps` are plain operators in an executable order, `lags` windows
    between them, by their places.

    Raises `Unstructured`.
    """
    return _Assembly(task, tuple(steps), goals, tuple(subjects), wishes, tuple(lags)).work()


@dataclass(frozen=True)
class _Assembly:
    task: GroundTask
    steps: tuple[GroundOperator, ...]
    goals: Bits
    subjects: tuple[Term, ...]
    wishes: Wishes
    lags: tuple[StepLag, ...] = ()

    def work(self) -> CellWork:
        holds: list[Hold] = []
        visits: dict[str, tuple[PlaceVisit, ...]] = {}
        places: dict[str, tuple[Term, ...]] = {}
        windows = [window for job in self.jobs for window in chain_windows(job.stages)]
        for group, group_visits in self._pools():
            name = str(group[0].arguments[0]) if group[0].arguments else str(group[0])
            held = [Hold(name, hold.begin, hold.end) for _, hold in group_visits]
            if len({self._owner(hold) for hold in held}) > 1:
                holds += held
                places[name] = tuple(atom.arguments[0] for atom in group if atom.arguments)
                visits[name] = tuple(self._visits(name, group_visits))
            windows += [w for atom, hold in group_visits for w in self._stay(atom, hold)]
        holds += self._shared_resources(tuple(places.values()))
        windows += [*self._links(), *self._between_steps()]
        resources = [
            *map(self._arm_resource, self.arms),
            *(self._resource(held_resource, places) for held_resource in _hold_resources(holds)),
        ]
        devices = tuple(mechanism.device for mechanism in self.mechanisms)
        shop = Shop(
            self.jobs, tuple(resources), tuple(dict.fromkeys(windows)), tuple(holds), devices
        )
        known = {mechanism.device.name: mechanism for mechanism in self.mechanisms}
        return CellWork(shop, self.named, known, visits, places)

    @cached_property
    def arms(self) -> tuple[Term, ...]:
        return arm_resources(self.steps, self.subjects)

    @cached_property
    def cut(self) -> tuple[Block, ...]:
        """The blocks of the plan in its order, without those that are not necessary."""
        blocks = cut_blocks(self.task, self.steps, self.arms, self.subjects)
        return tuple(necessary_blocks(self.task, blocks, self.goals))

    @cached_property
    def named(self) -> dict[str, Block]:
        """The blocks that serve an object or a stage, without detours, by the name of the stage
        they become.
        """
        places = bitset(list(self._held(self._touches(_stage_blocks(self.cut)))))
        return _stage_blocks(remove_detours(self.cut, places | atoms_about(self.task, *self.arms)))

    @cached_property
    def mechanisms(self) -> tuple[DeviceMechanism, ...]:
        return find_mechanisms(self.task, self.arms, self.cut, self.goals, self._place)

    def _place(self, step: GroundOperator) -> str:
        place_terms = self.wishes.place(step.instance, step.resources, *self.arms)
        return "" if place_terms is None else str(place_terms)

    @cached_property
    def jobs(self) -> tuple[ShopJob, ...]:
        stages_by_subject: dict[Term | None, list[ShopStage]] = {}
        for name, block in self.named.items():
            needs = tuple(need for mechanism in self.mechanisms for need in mechanism.needs(block))
            ends = (
                (self._place(block.steps[0]), self._place(block.steps[-1]))
                if block.arms
                else ("", "")
            )
            stage = ShopStage(name, block.duration, tuple(map(str, block.arms)), needs, *ends)
            stages_by_subject.setdefault(block.subject, []).append(stage)
        ordered = [subject for subject in (*self.subjects, None) if subject in stages_by_subject]
        return tuple(self._job(subject, tuple(stages_by_subject[subject])) for subject in ordered)

    def _job(self, subject: Term | None, stages: tuple[ShopStage, ...]) -> ShopJob:
        if subject is None:
            return ShopJob(OTHER_WORK_JOB, stages)
        wishes = self.wishes
        times = (
            wishes.release.get(subject, 0),
            wishes.due.get(subject),
            wishes.priority.get(subject, 1),
        )
        return ShopJob(str(subject), stages, *times)

    @cached_property
    def touches(self) -> dict[int, list[AtomTouch]]:
        """What stages do to each atom, in the order of the plan.

        Atoms of the arm and of devices are left out.
        """
        return self._touches(self.named)

    def _touches(self, named: Mapping[str, Block]) -> dict[int, list[AtomTouch]]:
        private = atoms_about(self.task, *self.arms)
        for mechanism in self.mechanisms:
            private |= mechanism.atoms
        touches: dict[int, list[AtomTouch]] = defaultdict(list)
        for name, block in named.items():
            for (step, begin, end), ends, makes in zip(
                block.timed, block.ends, block.makes, strict=True
            ):
                for atom in indices((step.preconditions | ends | makes) & ~private):
                    does = (bool(bits >> atom & 1) for bits in (step.preconditions, ends, makes))
                    touches[atom].append(AtomTouch(name, str(block.subject), begin, end, *does))
        return touches

    @cached_property
    def held(self) -> dict[Function, list[Hold]]:
        """The atoms that say that a place is free, with the holds of this place."""
        return {
            self.task.atoms[number]: holds for number, holds in self._held(self.touches).items()
        }

    def _held(self, touches: Mapping[int, Sequence[AtomTouch]]) -> dict[int, list[Hold]]:
        holds_by_atom: dict[int, list[Hold]] = {}
        for number, atom_touches in touches.items():
            if any(touch.ends for touch in atom_touches) and any(
                touch.makes for touch in atom_touches
            ):
                holds = place_holds_of("", atom_touches, bool(self.task.initial >> number & 1))
                if holds is not None:
                    holds_by_atom[number] = holds
        return holds_by_atom

    def _pools(self) -> Iterator[tuple[tuple[Function, ...], list[tuple[Function, Hold]]]]:
        """Groups of atoms whose places can be exchanged, with all holds of these places."""
        exchange = Exchange(self.task, self.goals)
        done: set[Function] = set()
        for atom in self.held:
            if atom not in done:
                group = exchange.alike(atom)
                done |= set(group)
                yield (
                    group,
                    [
                        (pooled_atom, hold)
                        for pooled_atom in group
                        for hold in self.held.get(pooled_atom, [])
                    ],
                )

    def _owner(self, hold: Hold) -> Term | None:
        moment = hold.begin or hold.end
        return self.named[moment.stage].subject if moment else None

    def _visits(self, name: str, visits: Sequence[tuple[Function, Hold]]) -> Iterator[PlaceVisit]:
        for atom, hold in visits:
            if atom.arguments:
                yield PlaceVisit(
                    Hold(name, hold.begin, hold.end), atom.arguments[0], self._between(hold)
                )

    def _between(self, hold: Hold) -> tuple[str, ...]:
        """The stages of the object from the one that takes the place to the one that leaves it."""
        own = [name for name, block in self.named.items() if block.subject == self._owner(hold)]
        first = own.index(hold.begin.stage) if hold.begin else 0
        last = own.index(hold.end.stage) if hold.end else len(own) - 1
        return tuple(own[first : last + 1])

    def _stay(self, atom: Function, hold: Hold) -> Iterator[StageWindow]:
        """Windows for the longest stay in a place.

        They go from the end of the step that brings an object to the start of the step that takes
        it.
        """
        for place, most in self.wishes.longest_stay.items():
            if (
                contains_term(atom, place)
                and hold.begin
                and hold.end
                and hold.begin.stage != hold.end.stage
            ):
                came = next(t for t in self._at(atom) if t.first == hold.begin)
                left = next(t for t in self._at(atom) if t.last == hold.end)
                yield StageWindow(came.last, left.first, 0, most)

    def _at(self, atom: Function) -> list[AtomTouch]:
        return self.touches[self.task.atoms.index(atom)]

    def _shared_resources(self, pools: Sequence[tuple[Term, ...]]) -> Iterator[Hold]:
        """Holds of other resources that steps of several objects use, if no place keeps these
        steps apart.
        """
        kept = {*self.arms, *self.subjects, *itertools.chain(*pools)}
        users: dict[Term, list[AtomTouch]] = defaultdict(list)
        for name, block in self.named.items():
            for step, begin, end in block.timed:
                for resource in (
                    other_resource
                    for other_resource in step.resources
                    if other_resource not in kept
                ):
                    users[resource].append(
                        AtomTouch(name, str(block.subject), begin, end, True, False, False)
                    )
        for resource, touches in users.items():
            if len({touch.job for touch in touches}) > 1:
                yield from (Hold(str(resource), touch.first, touch.last) for touch in touches)

    def _links(self) -> Iterator[StageWindow]:
        """Windows that keep the plan's order between objects that change the same atom, unless it
        is about a place.
        """
        for number, touches in self.touches.items():
            if self.task.atoms[number] in self.held:
                continue
            for one, other in itertools.combinations(touches, 2):
                changes = one.ends or one.makes or other.ends or other.makes
                if one.job != other.job and changes:
                    yield StageWindow(one.last, other.first)

    def _between_steps(self) -> Iterator[StageWindow]:
        """The windows between steps that are done once, and in different stages.

        Raises `Unstructured`.
        """
        count = Counter(map(id, self.steps))
        moments = {
            id(step): StageMoment(name, begin)
            for name, block in self.named.items()
            for step, begin, _ in block.timed
        }
        for lag in self.lags:
            if lag.earlier.step < 0 or lag.later.step < 0:
                continue
            one, other = (id(self.steps[moment.step]) for moment in (lag.earlier, lag.later))
            if count[one] == count[other] == 1 and one in moments and other in moments:
                earlier, later = (
                    replace(moments[key], offset=moments[key].offset + moment.offset)
                    for key, moment in ((one, lag.earlier), (other, lag.later))
                )
                window = StageWindow(earlier, later, lag.least, lag.most)
                if window.earlier.stage != window.later.stage:
                    yield window
                elif not _is_kept_inside(window):
                    raise Unstructured("an errand in one piece breaks a window")

    def _arm_resource(self, arm: Term) -> Resource:
        travel = {(str(a), str(b)): lasts for (a, b), lasts in self.wishes.travel.items()}
        return Resource(str(arm), 1, travel)

    def _resource(self, name: str, places: Mapping[str, tuple[Term, ...]]) -> Resource:
        units = tuple(map(str, sorted(places.get(name, ()), key=natural_key)))
        return Resource(name, max(1, len(units)), units=units)


def _stage_blocks(blocks: Sequence[Block]) -> dict[str, Block]:
    """The blocks that serve an object or a stage, by the name of the stage they become."""
    blocks_by_name: dict[str, Block] = {}
    numbers: dict[Term | None, Iterator[int]] = defaultdict(lambda: itertools.count(1))
    for block in (serving_block for serving_block in blocks if serving_block.serves):
        said = " ".join(dict.fromkeys(step.instance.name for step in block.steps))
        owner = block.subject if block.subject is not None else OTHER_WORK_JOB
        blocks_by_name[f"{owner} {next(numbers[block.subject])} {said}"] = block
    return blocks_by_name


def _hold_resources(holds: Sequence[Hold]) -> list[str]:
    return list(dict.fromkeys(hold.resource for hold in holds))


def _is_kept_inside(window: StageWindow) -> bool:
    """Whether a window within one stage is kept."""
    lasts = window.later.offset - window.earlier.offset
    return lasts >= window.least and (window.most is None or lasts <= window.most)


class Mislaid(Exception):
    """A step of the schedule cannot be executed at its time."""


@dataclass(frozen=True, slots=True)
class TimedStep:
    """A step of the task and when it starts."""

    operator: GroundOperator
    start: int

    @property
    def end(self) -> int:
        """When the step ends."""
        return self.start + self.operator.duration


def timed_steps(task: GroundTask, work: CellWork, schedule: Schedule) -> tuple[TimedStep, ...]:
    """The steps of a schedule, in an executable order. Raises `Mislaid`."""
    wanted = sorted(
        _scheduled_steps(work, schedule), key=lambda timed_step: (timed_step.start, timed_step.end)
    )
    stages = bitset([number for number, atom in enumerate(task.atoms) if atom.name == STAGE_FLUENT])
    variants: dict[Function, list[GroundOperator]] = {}
    for operator in task.operators:
        variants.setdefault(operator.instance, []).append(operator)
    state, made = task.initial, []
    for timed in wanted:
        operator = _executable_variant(timed.operator, variants, state, stages)
        made.append(TimedStep(operator, timed.start))
        state = progress_state(state, operator)
    return tuple(made)


def _executable_variant(
    wanted: GroundOperator,
    variants: Mapping[Function, Sequence[GroundOperator]],
    state: Bits,
    stages: Bits,
) -> GroundOperator:
    """The operator that does the wanted step in a state: the step itself, or one of the same
    instance.
    """
    fitting = [
        variant
        for variant in (wanted, *variants.get(wanted.instance, ()))
        if variant.preconditions & ~state == 0
        and variant.adds & stages == wanted.adds & stages
        and not variant.conditional
    ]
    if not fitting:
        raise Mislaid(f"{wanted.instance} cannot be done")
    return fitting[0]


def _scheduled_steps(work: CellWork, schedule: Schedule) -> Iterator[TimedStep]:
    renamed = _places_by_stage(work, schedule)
    for name, block in work.blocks.items():
        for step, begin, _ in block.timed:
            there = _rename_places(step, renamed.get(name, {}))
            yield TimedStep(there, schedule.starts[name] + begin)
    for adjustment in schedule.adjustments:
        now = adjustment.start
        for step in work.mechanisms[adjustment.device].paths[
            adjustment.change.before, adjustment.change.after
        ]:
            yield TimedStep(step, now)
            now += step.duration


def _rename_places(step: GroundOperator, places: Mapping[Term, Term]) -> GroundOperator:
    """The step at other places.

    What it needs there is looked up by its new name; its stage stays the same.
    """
    instance = exchange_subterms(step.instance, places)
    if instance == step.instance or not isinstance(instance, Function):
        return step
    impossible = -1  # no state has it: only operators with the new name are tried
    return GroundOperator(
        instance, impossible, step.adds, step.deletes, (), step.resources, step.duration, step.cost
    )


def _places_by_stage(work: CellWork, schedule: Schedule) -> dict[str, dict[Term, Term]]:
    """For each stage, the places that it names, each with the place that it gets instead."""
    renamed_places: dict[str, dict[Term, Term]] = {}
    for resource, visits in work.visits.items():
        for visit, place in _assign_places(visits, work.places[resource], schedule):
            for stage in visit.stages:
                renamed_places.setdefault(stage, {})[visit.place] = place
    return renamed_places


def places_of_visits(work: CellWork, schedule: Schedule) -> dict[Hold, str]:
    """The place of each visit. Raises `Mislaid`."""
    return {
        visit.hold: str(place)
        for resource, visits in work.visits.items()
        for visit, place in _assign_places(visits, work.places[resource], schedule)
    }


def _assign_places(
    visits: Sequence[PlaceVisit], places: Sequence[Term], schedule: Schedule
) -> Iterator[tuple[PlaceVisit, Term]]:
    """A place for each visit, first come, first served.

    A visit keeps its own place if that is free.
    """
    until = dict.fromkeys(places, 0)
    for visit in sorted(
        visits,
        key=lambda place_visit: (
            _hold_begin(place_visit.hold, schedule),
            _hold_end(place_visit.hold, schedule),
        ),
    ):
        begin, end = _hold_begin(visit.hold, schedule), _hold_end(visit.hold, schedule)
        free = [place for place in (visit.place, *places) if until[place] <= begin]
        if not free:
            raise Mislaid(f"no place of {visit.hold.resource} is free at {begin}")
        until[free[0]] = end
        yield visit, free[0]


def _hold_begin(hold: Hold, schedule: Schedule) -> int:
    return _time_at(hold.begin, schedule) if hold.begin else 0


def _hold_end(hold: Hold, schedule: Schedule) -> int:
    return _time_at(hold.end, schedule) if hold.end else schedule.makespan + 1


def _time_at(moment: StageMoment, schedule: Schedule) -> int:
    return schedule.starts[moment.stage] + moment.offset
