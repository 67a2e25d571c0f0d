"""Late choice: which of several equal objects, depots or tools is used is decided only when the run would have to wait.

A plan names them all, because a plan has to be checked. When nothing can begin, and the run waits for
something that needs no hand, what is busy and what is free exchange their roles in the steps that have not begun, if the
run ends sooner then (after Fox and Kempf 1985). Nobody has to declare what is equal: terms are exchanged if their facts
and goals correspond, and the exchanged plan passes the gate like every plan.
"""

from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from cellwright.engine.model.forecast import earliest_starts
from cellwright.engine.pipelines.execution.adding import is_wish
from cellwright.engine.pipelines.execution.compiling import hands_of, unit_ms
from cellwright.engine.pipelines.execution.joining import Joined, ahead, joined, left_behind
from cellwright.engine.pipelines.execution.planned import SHORT, in_windows, ready
from cellwright.engine.pipelines.execution.progress import Progress
from cellwright.engine.pipelines.execution.scope import Scope
from cellwright.engine.pipelines.gate import PlanGate
from cellwright.kb.model.conditions import Literal, goal_parts
from cellwright.kb.model.domain import Kind
from cellwright.kb.model.plan import Plan, Step, in_sequence
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import Atom, Function, Term, natural_key

Exchange = Mapping[Term, Term]  # each term and the one in its place; it is its own reverse


@dataclass(frozen=True, slots=True)
class Choice:
    """A program in which equal things have exchanged their roles, and which ones these are."""

    joined: Joined
    what: str


def choices(course: Progress, scope: Scope) -> Iterator[Choice]:
    """The plan with equal things in place of those that steps under way are busy with."""
    left = left_behind(course)
    if not left.steps or len(left.steps) > SHORT:
        return
    state, now = ahead(course), course.driver.now_ms()
    rest = scope.rest(state)
    for exchange, plan in others(rest, state.facts, busy(course, rest), left, course.gate):
        if _as_urgent(rest, exchange):
            made = in_windows(rest, plan, now, course.since) or ready(
                rest, plan, earliest_starts(plan), now, since=course.since
            )
            yield Choice(joined(course, scope, made), _said(exchange, left.steps))


def others(
    rest: Problem, facts: Iterable[Atom], taken: Collection[Term], left: Plan, gate: PlanGate
) -> Iterator[tuple[Exchange, Plan]]:
    """What is left of a plan with equal things in place of some, each way once, if the checker accepts it."""
    tried = set[frozenset[tuple[Term, Term]]]()
    for exchange in exchanges(rest, facts, taken, left.steps, gate):
        if (pairs := frozenset(exchange.items())) in tried:
            continue
        tried.add(pairs)
        plan = Plan(tuple(_exchanged(step, exchange) for step in left.steps))
        if not gate.findings(rest, in_sequence(plan)):
            yield exchange, plan


def exchanges(
    rest: Problem, facts: Iterable[Atom], taken: Collection[Term], steps: Sequence[Step], gate: PlanGate
) -> Iterator[Exchange]:
    """What could be exchanged for what is busy: with each equal thing, all that goes with the two of them."""
    known = _Facts(rest, facts, gate)
    named = {term for step in steps for term in (*step.operator.arguments, *step.resources)}
    for one in sorted(taken, key=natural_key):
        for other in sorted(named - {one}, key=natural_key):
            if known.kindred(one, other):
                yield known.exchange(one, other)


def busy(course: Progress, rest: Problem) -> Mapping[Term, int]:
    """What steps under way are about, but hands, and for how many units of time it will be."""
    steps = {int(step.id): step for step in course.compiled.plan.steps}
    hands, unit = hands_of(rest, course.compiled.plan.steps), unit_ms(rest.domain)
    found: dict[Term, int] = {}
    for each in course.standing.running.values():
        lasts = each.since_ms + course.compiled.program.activities[each.activity].lasts_ms
        left = max(0, -((course.driver.now_ms() - lasts) // unit))
        step = steps[each.activity]
        for term in (*step.operator.arguments, *step.resources):
            if isinstance(term, Function) and str(term) not in hands:
                found[term] = max(left, found.get(term, 0))
    return found


class _Facts:
    """What is true and what is wanted, by the terms that it is about."""

    def __init__(self, rest: Problem, facts: Iterable[Atom], gate: PlanGate) -> None:
        self.types = {**rest.domain.objects, **rest.objects}
        goals = [part.atom for part in goal_parts(rest.goal) if isinstance(part, Literal)]
        wanted = [Function(f"goal {atom.name}", atom.arguments) for atom in goals]
        wanted += [
            Function(f"stage {number} {stage.name}", stage.arguments)
            for chain in rest.chains
            for number, stage in enumerate(chain.stages)
        ]
        self.all = {*facts, *_statics(rest, gate), *wanted}
        self.about: dict[Term, list[Atom]] = defaultdict(list)
        for atom in sorted(self.all, key=natural_key):
            for term in dict.fromkeys(atom.arguments):
                self.about[term].append(atom)

    def kindred(self, one: Term, other: Term) -> bool:
        """Whether two terms could be equal: objects of one type, or compound terms of one function."""
        if not isinstance(one, Function) or not isinstance(other, Function):
            return False
        if one.arguments or other.arguments:
            return one.name == other.name and one.arguments[:-1] == other.arguments[:-1]
        return one.name in self.types and self.types[one.name] == self.types.get(other.name)

    def exchange(self, one: Term, other: Term) -> Exchange:
        """The two exchanged, and with them what differs in facts about them that correspond: the depots of two probes, say."""
        found: dict[Term, Term] = {one: other, other: one}
        open_ = [(one, other)]
        while open_:
            here, there = open_.pop()
            for atom in self.about[here]:
                image = _image(atom, found)
                if image in self.all:
                    continue
                pair = next(
                    filter(None, (self._differ(image, each, found) for each in self.about[there])), None
                )
                if pair is not None:
                    found |= {pair[0]: pair[1], pair[1]: pair[0]}
                    open_.append(pair)
        return found

    def _differ(self, image: Atom, other: Atom, found: Exchange) -> tuple[Term, Term] | None:
        """The only terms in which two atoms differ, if these can be exchanged as well."""
        if image.name != other.name or len(image.arguments) != len(other.arguments):
            return None
        pairs = [(a, b) for a, b in zip(image.arguments, other.arguments, strict=True) if a != b]
        if len(pairs) != 1 or any(each in found for each in pairs[0]) or not self.kindred(*pairs[0]):
            return None
        return pairs[0]


def _statics(rest: Problem, gate: PlanGate) -> Iterator[Atom]:
    """The static facts that are about several things."""
    known = gate.semantics(rest).statics
    for name, predicate in rest.domain.predicates.items():
        if predicate.kind is Kind.STATIC and len(predicate.arguments) > 1:
            yield from known.named(name)


def _image(term: Term, exchange: Exchange) -> Function:
    """A term in which terms are exchanged."""
    found = exchange.get(term, term)
    assert isinstance(found, Function)
    if found is not term or not found.arguments:
        return found
    arguments = tuple(
        _image(each, exchange) if isinstance(each, Function) else each for each in found.arguments
    )
    return Function(found.name, arguments)


def _as_urgent(rest: Problem, exchange: Exchange) -> bool:
    """Whether what is exchanged is due at the same times."""
    times = [atom for atom in rest.statics if is_wish(rest, atom)]
    return all(_image(atom, exchange) in times for atom in times)


def _exchanged(step: Step, exchange: Exchange) -> Step:
    resources = tuple(
        _image(each, exchange) if isinstance(each, Function) else each for each in step.resources
    )
    return replace(step, operator=_image(step.operator, exchange), resources=resources)


def _said(exchange: Exchange, steps: Sequence[Step]) -> str:
    """What is exchanged, as far as the steps name it."""
    named = {term for step in steps for term in (*step.operator.arguments, *step.resources)}
    pairs = {tuple(sorted(map(str, pair))) for pair in exchange.items() if named & set(pair)}
    return ", ".join(" and ".join(pair) for pair in sorted(pairs))
