"""Turns a schedule back into steps: where each object goes, which steps change devices, and when each starts."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from cellwright.engine.model.schedule import Schedule
from cellwright.engine.model.shop import Hold, Moment
from cellwright.engine.model.stages import STAGE
from cellwright.engine.model.task import Bits, GroundOperator, Task, bitset, progress
from cellwright.engine.stages.scheduling.work import CellWork, PlaceVisit
from cellwright.kb.terms import Function, Term, exchanged


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


def timed_steps(task: Task, work: CellWork, schedule: Schedule) -> tuple[TimedStep, ...]:
    """The steps of a schedule, in an executable order. Raises `Mislaid`."""
    wanted = sorted(_wanted(work, schedule), key=lambda each: (each.start, each.end))
    stages = bitset([number for number, atom in enumerate(task.atoms) if atom.name == STAGE])
    variants: dict[Function, list[GroundOperator]] = {}
    for operator in task.operators:
        variants.setdefault(operator.instance, []).append(operator)
    state, made = task.initial, []
    for each in wanted:
        operator = _variant(each.operator, variants, state, stages)
        made.append(TimedStep(operator, each.start))
        state = progress(state, operator)
    return tuple(made)


def _variant(
    wanted: GroundOperator, variants: Mapping[Function, Sequence[GroundOperator]], state: Bits, stages: Bits
) -> GroundOperator:
    """The operator that does the wanted step in a state: the step itself, or one of the same instance."""
    fitting = [
        each
        for each in (wanted, *variants.get(wanted.instance, ()))
        if each.preconditions & ~state == 0
        and each.adds & stages == wanted.adds & stages
        and not each.conditional
    ]
    if not fitting:
        raise Mislaid(f"{wanted.instance} cannot be done")
    return fitting[0]


def _wanted(work: CellWork, schedule: Schedule) -> Iterator[TimedStep]:
    renamed = _renamed(work, schedule)
    for name, block in work.blocks.items():
        for step, begin, _ in block.timed:
            there = _rename(step, renamed.get(name, {}))
            yield TimedStep(there, schedule.starts[name] + begin)
    for each in schedule.adjustments:
        now = each.start
        for step in work.mechanisms[each.device].paths[each.change.before, each.change.after]:
            yield TimedStep(step, now)
            now += step.duration


def _rename(step: GroundOperator, places: Mapping[Term, Term]) -> GroundOperator:
    """The step at other places.

    What it needs there is looked up by its new name; its stage stays the same.
    """
    instance = exchanged(step.instance, places)
    if instance == step.instance or not isinstance(instance, Function):
        return step
    impossible = -1  # no state has it: only operators with the new name are tried
    return GroundOperator(
        instance, impossible, step.adds, step.deletes, (), step.resources, step.duration, step.cost
    )


def _renamed(work: CellWork, schedule: Schedule) -> dict[str, dict[Term, Term]]:
    """For each stage, the places that it names, each with the place that it gets instead."""
    found: dict[str, dict[Term, Term]] = {}
    for resource, visits in work.visits.items():
        for visit, place in _assigned(visits, work.places[resource], schedule):
            for stage in visit.stages:
                found.setdefault(stage, {})[visit.place] = place
    return found


def units(work: CellWork, schedule: Schedule) -> dict[Hold, str]:
    """The place of each visit. Raises `Mislaid`."""
    return {
        visit.hold: str(place)
        for resource, visits in work.visits.items()
        for visit, place in _assigned(visits, work.places[resource], schedule)
    }


def _assigned(
    visits: Sequence[PlaceVisit], places: Sequence[Term], schedule: Schedule
) -> Iterator[tuple[PlaceVisit, Term]]:
    """A place for each visit, first come, first served. A visit keeps its own place if that is free."""
    until = dict.fromkeys(places, 0)
    for visit in sorted(visits, key=lambda each: (_begin(each.hold, schedule), _end(each.hold, schedule))):
        begin, end = _begin(visit.hold, schedule), _end(visit.hold, schedule)
        free = [place for place in (visit.place, *places) if until[place] <= begin]
        if not free:
            raise Mislaid(f"no place of {visit.hold.resource} is free at {begin}")
        until[free[0]] = end
        yield visit, free[0]


def _begin(hold: Hold, schedule: Schedule) -> int:
    return _at(hold.begin, schedule) if hold.begin else 0


def _end(hold: Hold, schedule: Schedule) -> int:
    return _at(hold.end, schedule) if hold.end else schedule.makespan + 1


def _at(moment: Moment, schedule: Schedule) -> int:
    return schedule.starts[moment.stage] + moment.offset
