"""Durations, costs and resources of operator instances, from facts and declared travel.

In a duration or a cost, `weight(Tool)` stands for the last argument of the only fact `weight(Tool,
N)`, and `travel(From, To)` for the time between two places. What cannot be told is an error, never
a default.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field

from cellwright.kb.arithmetic import evaluate_term, wraps_around
from cellwright.kb.model.domain_model import (
    DISTANCE_TERM,
    NUMERIC_TYPES,
    Domain,
    Kind,
    Motion,
    Operator,
    Point,
    Predicate,
    distance_um,
)
from cellwright.kb.model.plan_model import Step, StepId
from cellwright.kb.terms import Function, Number, Operation, Substitution, Term, substitute_term

MAX_AMOUNT = 2**31 - 1  # clingo counts in 32 bits

Arguments = tuple[Term, ...]
# the arguments of all facts of a static predicate
Facts = Callable[[str, int], Iterable[Arguments]]
Standing = Callable[[str], Point | None]  # the point that the cell gives to a place, in micrometres


class NoAmount(Exception):
    """A duration, a cost or a travel time that cannot be told.

    The text says why; `hint` says what to try.
    """

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.hint = hint


class NotTold(NoAmount):
    """No fact tells the number."""


@dataclass
class Amounts:
    """Durations and costs of one problem. Facts are read when they are first needed, once for each
    predicate.

    `facts` gives the static facts of the problem, and `standing` the points of the cell's places.
    `measured` says how long some steps last, in place of what their operators say.
    """

    domain: Domain
    facts: Facts
    standing: Standing
    measured: Mapping[Function, int] = field(default_factory=dict)
    _tables: dict[tuple[str, int], dict[Arguments, list[Term]]] = field(default_factory=dict)
    _points: dict[Term, Point] = field(default_factory=dict)

    def of(self, term: Term | None, bindings: Substitution, default: int) -> int:
        """A duration or cost under bindings; `default` if nothing is said. Raises `NoAmount`."""
        if term is None:
            return default
        if isinstance(term, Number):
            return term.value
        known = self._known(substitute_term(term, bindings))
        if wraps_around(known):
            raise NoAmount(
                f"{known} is too large a number", "numbers have 32 bits: take a larger unit of time"
            )
        value = evaluate_term(known)
        if not isinstance(value, Number):
            raise NoAmount(f"{known} has no value", "exclude this with a condition in `where:`")
        return value.value

    def lasting(self, operator: Operator, bindings: Substitution) -> int:
        """How long an instance of an operator lasts. Raises `NoAmount`."""
        if self.measured:
            instance = Function(
                operator.name, tuple(bindings[variable] for variable in operator.variables)
            )
            if instance in self.measured:
                return self.measured[instance]
        return self.of(operator.duration, bindings, 0)

    def range_of(self, operator: Operator, bindings: Substitution) -> "DurationRange":
        """Within what the duration of an instance varies; its duration alone if it does not.

        A duration that is told of the instance lies in the range. Raises `NoAmount`.
        """
        usual, varies = self.lasting(operator, bindings), operator.varies
        if varies is None:
            return DurationRange(usual, usual, usual)
        least, most = (self.of(term, bindings, usual) for term in (varies.least, varies.most))
        least = max(0, least)
        if least > most:
            instance = Function(operator.name, tuple(bindings[v] for v in operator.variables))
            hint = "the least duration must not exceed the greatest one"
            raise NoAmount(f"{instance} takes from {least} to {most}", hint)
        spread = self.of(varies.spread, bindings, 0)
        return DurationRange(min(least, usual), usual, max(most, usual), max(0, spread))

    def travel_time(self, here: Term, there: Term) -> int:
        """The declared travel time between two places, in the domain's unit. Raises `NoAmount`."""
        return self._number(Function(self.domain.conventions.travel, (here, there)))

    def point(self, place: Term) -> Point:
        """Where a place is, in micrometres: its own position, that of its measurement, or that of
        the cell.

        Raises `NoAmount`.
        """
        if place not in self._points:
            self._points[place] = self._position(place)
        return self._points[place]

    def _position(self, place: Term) -> Point:
        words = self.domain.conventions
        names = [place]
        if isinstance(place, Function) and place.name == words.meas and len(place.arguments) == 1:
            names.append(place.arguments[0])
        for name in names:
            if given := self._position_facts().get((name,)):
                return _only_point(name, given)
        standing = self.standing(str(place))
        if standing is None:
            fact = (
                f"the fact {words.position}({names[-1]}, X, Y, Z), or "
                if self._takes(names[-1])
                else ""
            )
            raise NoAmount(
                f"the position of {place} is not known",
                f"add {fact}the place {place} to `places` of cell.yaml",
            )
        return standing

    def _takes(self, thing: Term) -> bool:
        """Whether a fact can give the position of a thing, as far as the domain tells of what
        type it is.
        """
        known = self.domain.predicates.get(self.domain.conventions.position)
        if known is None or not isinstance(thing, Function):
            return False
        built = self.domain.functions.get(thing.name)
        type_ = built.result if built else self.domain.objects.get(thing.name)
        return type_ is None or self.domain.is_subtype(type_, known.arguments[0])

    def _position_facts(self) -> dict[Arguments, list[Term]]:
        """The positions that facts give, as terms of three arguments."""
        name = self.domain.conventions.position
        key = (name, 4)
        if key not in self._tables:
            table: dict[Arguments, list[Term]] = {}
            for thing, *rest in self.facts(name, 4):
                table.setdefault((thing,), []).append(Function("", tuple(rest)))
            self._tables[key] = table
        return self._tables[key]

    def _known(self, term: Term) -> Term:
        """A ground term with numbers in place of what facts and travel give."""
        match term:
            case Operation(operator, left, right):
                return Operation(operator, self._known(left), self._known(right))
            case Function(name, arguments) if _asks_in_domain(self.domain, name, len(arguments)):
                return Number(self._number(term))
            case _:
                return term

    def _number(self, asked: Function) -> int:
        """What a duration asks for. Raises `NoAmount`."""
        motion, travel = self.domain.motion, self.domain.conventions.travel
        if asked.name not in (travel, DISTANCE_TERM) or len(asked.arguments) != 2:
            return self._listed(asked)
        if asked.name == travel and self._table(travel, 2).get(asked.arguments):
            return self._listed(asked)
        here, there = asked.arguments
        if here == there:
            return 0
        return self._listed(asked) if motion is None else self._way(motion, asked)

    def _way(self, motion: Motion, asked: Function) -> int:
        """A travel time or distance along the straight line."""
        here, there = map(self.point, asked.arguments)
        value = (
            distance_um(here, there) if asked.name == DISTANCE_TERM else motion.time(here, there)
        )
        if value > MAX_AMOUNT:
            raise NoAmount(
                f"{asked} is {value}, larger than {MAX_AMOUNT}", "choose a larger unit of time"
            )
        return value

    def _listed(self, asked: Function) -> int:
        """The number that the facts of a predicate give to its other arguments."""
        given = self._table(asked.name, len(asked.arguments)).get(asked.arguments, [])
        fact = f"{asked.name}({', '.join(map(str, asked.arguments))}, N)"
        if not given:
            raise NotTold(f"{asked} is not known", f"add the fact {fact}")
        if len(given) > 1:
            said = " and ".join(sorted(map(str, given))[:2])
            raise NoAmount(
                f"{asked} has {len(given)} values, such as {said}", f"keep one fact {fact}"
            )
        if not isinstance(given[0], Number):
            raise NoAmount(f"{asked} is {given[0]}, which is no number", "write a whole number")
        if asked.name == self.domain.conventions.travel and given[0].value < 0:
            raise NoAmount(f"{asked} is {given[0]}", "a time must be 0 or more")
        return given[0].value

    def _table(self, name: str, arity: int) -> dict[Arguments, list[Term]]:
        key = (name, arity + 1)
        if key not in self._tables:
            table: dict[Arguments, list[Term]] = {}
            for *arguments, value in self.facts(name, arity + 1):
                table.setdefault(tuple(arguments), []).append(value)
            self._tables[key] = table
        return self._tables[key]


@dataclass(frozen=True, slots=True)
class DurationRange:
    """How long a step may last, and what is planned with, in the domain's unit of time.

    Without a `spread` (a standard deviation), all durations in the range are as likely.
    """

    least: int
    usual: int
    most: int
    spread: int = 0

    @property
    def varies(self) -> bool:
        """Whether there is more than one duration."""
        return self.least < self.most


def _only_point(name: Term, given: list[Term]) -> Point:
    """The point of a thing with exactly one position in numbers. Raises `NoAmount`."""
    if len(given) > 1:
        raise NoAmount(f"{name} has {len(given)} positions", "keep one of them")
    (point_term,) = given
    assert isinstance(point_term, Function)
    values = [
        coordinate.value for coordinate in point_term.arguments if isinstance(coordinate, Number)
    ]
    if len(values) < 3:
        point_text = ", ".join(map(str, point_term.arguments))
        raise NoAmount(
            f"the position of {name} is ({point_text}), which are no numbers", "write micrometres"
        )
    x, y, z = values
    return x, y, z


def asks_number(predicates: Mapping[str, Predicate], travel: str, name: str, arity: int) -> bool:
    """Whether a term of a duration or cost stands for a number: of a way, or of a static whose last
    argument is one.

    `travel` is what durations call travel times if the domain declares how an arm moves, else
    empty.
    """
    if travel and name in (travel, DISTANCE_TERM) and arity == 2:
        return True
    declared = predicates.get(name)
    return (
        declared is not None
        and declared.kind is Kind.STATIC
        and len(declared.arguments) == arity + 1
        and declared.arguments[-1] in NUMERIC_TYPES
    )


def _asks_in_domain(domain: Domain, name: str, arity: int) -> bool:
    return asks_number(
        domain.predicates, domain.conventions.travel if domain.motion else "", name, arity
    )


def number_terms(domain: Domain, term: Term | None) -> Iterator[Function]:
    """Every part of a duration or cost that stands for a number."""
    match term:
        case Operation(_, left, right):
            yield from number_terms(domain, left)
            yield from number_terms(domain, right)
        case Function(name, arguments) if _asks_in_domain(domain, name, len(arguments)):
            yield term
        case _:
            return


def travels_itself(domain: Domain) -> bool:
    """Whether a step of the domain spends the travel time itself, so that nobody else adds it
    between steps.
    """
    name = domain.conventions.travel
    return any(
        number_term.name == name
        for operator in domain.operators
        for number_term in number_terms(domain, operator.duration)
    )


@dataclass(frozen=True, slots=True)
class Traits:
    """The resources of an instance, its duration in the domain's unit of time, and its cost."""

    resources: tuple[Term, ...] = ()
    duration: int = 0
    cost: int = 1


def operator_traits(operator: Operator, instance: Function, amounts: Amounts) -> Traits | None:
    """The traits of an instance; None if a resource has no value, so that there is no such
    instance.

    Raises `NoAmount` if its duration or cost cannot be told.
    """
    bindings = dict(zip(operator.variables, instance.arguments, strict=True))
    resources = [
        evaluate_term(substitute_term(resource, bindings)) for resource in operator.resources
    ]
    held = tuple([resource for resource in resources if resource is not None])
    duration, cost = amounts.lasting(operator, bindings), amounts.of(operator.cost, bindings, 1)
    if operator.varies is not None:
        amounts.range_of(operator, bindings)
    if len(held) < len(resources):
        return None
    return Traits(held, duration, cost)


def range_of_step(amounts: Amounts, step: Step) -> DurationRange:
    """Within what the duration of a step varies; what is measured of a step does not.

    Raises `NoAmount`.
    """
    operator = next((o for o in amounts.domain.operators if o.name == step.operator.name), None)
    fits = operator is not None and len(operator.parameters) == len(step.operator.arguments)
    if operator is None or not fits or operator.varies is None:
        return DurationRange(step.duration, step.duration, step.duration)
    bindings = dict(zip(operator.variables, step.operator.arguments, strict=True))
    return amounts.range_of(operator, bindings)


def step_of(
    amounts: Amounts, number: StepId, instance: Function, after: tuple[StepId, ...] = ()
) -> Step:
    """A step with the traits that its domain gives it; those of no operator if it is no instance,
    or they cannot be told.

    The checker refuses such a step.
    """
    operator = next(
        (candidate for candidate in amounts.domain.operators if candidate.name == instance.name),
        None,
    )
    fits = operator is not None and len(operator.parameters) == len(instance.arguments)
    try:
        instance_traits = (
            operator_traits(operator, instance, amounts) if operator and fits else None
        ) or Traits()
    except NoAmount:
        instance_traits = Traits()
    return Step(
        number,
        instance,
        after,
        instance_traits.resources,
        instance_traits.duration,
        instance_traits.cost,
    )
