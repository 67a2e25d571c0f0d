"""What facts ask of times: longest dwell times, travel, releases, due dates; and who overstays."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

from cellwright.engine.model.time_limits import Overstay, Stay, windows_of
from cellwright.engine.stages.lifted.cell_domain import CellDomain, Situation
from cellwright.engine.stages.lifted.lifted_execution import changes_of
from cellwright.engine.stages.scheduling.plan_blocks import contains_term
from cellwright.engine.stages.scheduling.shop_translation import Wishes
from cellwright.engine.stages.validation.checker_facts import CheckerFacts
from cellwright.engine.stages.validation.operator_semantics import Semantics
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.model.name_conventions import Conventions
from cellwright.kb.model.operator_amounts import Amounts, NoAmount, travels_itself
from cellwright.kb.model.plan_model import Plan, StepId
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Atom, Function, Number, Term

NO_DURATIONS: Mapping[Atom, int] = {}


def find_overstays(
    problem: Problem,
    plan: Plan,
    starts: Mapping[StepId, int],
    longest: Mapping[Term, int],
    known: Semantics,
) -> tuple[Overstay, ...]:
    """What stays too long when the steps of a plan that is right start at these times, from the
    end of the step that brings it.
    """
    if not longest:
        return ()
    ends = {step.id: starts[step.id] + step.duration for step in plan.steps}
    start = Situation.of(CellDomain(problem), known.initial())
    stays_found = (
        Overstay(stay.thing, stay.place, starts[stay.target] - ends[stay.source], stay.most)
        for stay in stays_of(plan, longest, start)
    )
    return tuple(
        dict.fromkeys(overstay for overstay in stays_found if overstay.lasts > overstay.most)
    )


def stays_of(
    plan: Plan,
    longest: Mapping[Term, int],
    start: Situation,
    since: Mapping[Atom, int] = NO_DURATIONS,
) -> Iterator[Stay]:
    """Which step brings something to a place where it may not stay for long, and which one takes it
    away.

    What is there already counts from when it came, as far as that is known.
    """
    if not longest:
        return
    brought = {atom: StepId(0) for atom in since if atom in start.state}
    for step, change in zip(plan.steps, changes_of(start, plan.steps), strict=True):
        for atom in change.ends:
            if atom in brought:
                source = brought.pop(atom)
                came = None if int(source) else since[atom]
                for dwell in _dwell_limits(atom, longest):
                    yield Stay(source, step.id, dwell.most, came, dwell.thing, dwell.place)
        brought |= dict.fromkeys(change.adds, step.id)


@dataclass(frozen=True, slots=True)
class _DwellLimit:
    thing: str
    place: str
    most: int


def _dwell_limits(atom: Atom, longest: Mapping[Term, int]) -> Iterator[_DwellLimit]:
    """How long a fact may last that says where something is, in a place where nothing may stay
    for long.
    """
    for place, most in longest.items():
        inside = [contains_term(argument, place) for argument in atom.arguments]
        if any(inside) and not all(inside):
            things_there = [
                argument
                for argument, is_place in zip(atom.arguments, inside, strict=True)
                if not is_place
            ]
            # a quantity, as how much a bottle holds, stays nowhere
            if any(isinstance(thing, Function) for thing in things_there):
                yield _DwellLimit(", ".join(map(str, things_there)), str(place), most)


def wishes_for(known: Semantics, *plans: Plan) -> Wishes:
    """What the domain says about the times of plans.

    Where steps spend the declared travel time themselves, there is none between steps.
    """
    problem, domain = known.problem, known.problem.domain
    stated = replace(
        wishes_of(known.statics, domain.conventions),
        between=problem.all_windows,
        calendars=problem.all_calendars,
    )
    if travels_itself(domain):
        return replace(stated, travel={}, stops=frozenset())
    if domain.motion is None and not stated.travel:
        return stated
    steps = (step for plan in plans for step in plan.steps)
    terms = dict.fromkeys(term for s in steps for term in (*s.operator.arguments, *s.resources))
    mentioned = tuple(
        t for t in terms if t in stated.stops or (domain.motion and _is_place(known.amounts, t))
    )
    travel = TravelWays(mentioned, stated.travel, known.amounts, problem.where)
    return replace(stated, travel=travel, stops=stated.stops.union(mentioned))


def wishes_of(statics: CheckerFacts, words: Conventions) -> Wishes:
    """What static facts say about times."""

    def numbers(name: str) -> dict[Term, int]:
        facts = [atom.arguments for atom in statics.named(name) if len(atom.arguments) == 2]
        return {first: last.value for first, last in facts if isinstance(last, Number)}

    def triples(name: str) -> list[tuple[Term, ...]]:
        return [atom.arguments for atom in statics.named(name) if len(atom.arguments) == 3]

    trips = triples(words.travel)
    travel = {(a, b): lasts.value for a, b, lasts in trips if isinstance(lasts, Number)}
    stops = frozenset(place for pair in travel for place in pair)
    return Wishes(
        travel,
        stops,
        longest_stay=numbers(words.longest_stay),
        release=numbers(words.release),
        due=numbers(words.due),
        priority=numbers(words.priority),
        windows=windows_of(triples(words.window)),
    )


@dataclass(frozen=True, eq=False)
class TravelWays(Mapping[tuple[Term, Term], int]):
    """The travel times of all pairs that facts list, and with a declared motion between all places
    that plans mention.

    Each is computed when it is first asked for. Raises `InvalidInput` then for one that cannot be
    told.
    """

    mentioned: tuple[Term, ...]
    listed: Mapping[tuple[Term, Term], int]
    amounts: Amounts
    where: Source
    _known: dict[tuple[Term, Term], int] = field(default_factory=dict)

    def __getitem__(self, pair: tuple[Term, Term]) -> int:
        if self.amounts.domain.motion is None and pair not in self.listed:
            raise KeyError(pair)
        if pair not in self._known:
            try:
                self._known[pair] = self.amounts.travel_time(*pair)
            except NoAmount as error:
                raise InvalidInput(
                    [Diagnostic(self.where, "K115", str(error), error.hint)]
                ) from None
        return self._known[pair]

    def __iter__(self) -> Iterator[tuple[Term, Term]]:
        moving = self.mentioned if self.amounts.domain.motion else ()
        yield from dict.fromkeys(
            (
                *self.listed,
                *((start_place, end_place) for start_place in moving for end_place in moving),
            )
        )

    def __len__(self) -> int:
        return len(self.listed) or len(self.mentioned) ** 2


def _is_place(amounts: Amounts, term: Term) -> bool:
    try:
        amounts.point(term)
    except NoAmount:
        return False
    return True
