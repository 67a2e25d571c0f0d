"""What static facts and the declared travel say about times: ways between steps, longest stays, releases and due dates."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

from cellwright.engine.model.windows import windows_of
from cellwright.engine.stages.scheduling.work import Wishes
from cellwright.engine.stages.validation.facts import Facts
from cellwright.engine.stages.validation.semantics import Semantics
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.model.amounts import Amounts, NoAmount, travels_itself
from cellwright.kb.model.conventions import Conventions
from cellwright.kb.model.plan import Plan
from cellwright.kb.terms import Number, Term


def wishes_for(known: Semantics, *plans: Plan) -> Wishes:
    """What the domain says about the times of plans.

    Where steps spend the declared travel time themselves, there is none between steps.
    """
    domain, said = known.problem.domain, wishes_of(known.statics, known.problem.domain.conventions)
    if travels_itself(domain):
        return replace(said, travel={}, stops=frozenset())
    if domain.motion is None and not said.travel:
        return said
    steps = (step for plan in plans for step in plan.steps)
    terms = dict.fromkeys(term for s in steps for term in (*s.operator.arguments, *s.resources))
    mentioned = tuple(t for t in terms if t in said.stops or (domain.motion and _is_place(known.amounts, t)))
    travel = Ways(mentioned, said.travel, known.amounts, known.problem.where)
    return replace(said, travel=travel, stops=said.stops.union(mentioned))


def wishes_of(statics: Facts, words: Conventions) -> Wishes:
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
class Ways(Mapping[tuple[Term, Term], int]):
    """The travel times of all pairs that facts list, and with a declared motion between all places that plans mention.

    Each is computed when it is first asked for. Raises `InvalidInput` then for one that cannot be told.
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
                raise InvalidInput([Diagnostic(self.where, "K115", str(error), error.hint)]) from None
        return self._known[pair]

    def __iter__(self) -> Iterator[tuple[Term, Term]]:
        moving = self.mentioned if self.amounts.domain.motion else ()
        yield from dict.fromkeys((*self.listed, *((here, there) for here in moving for there in moving)))

    def __len__(self) -> int:
        return len(self.listed) or len(self.mentioned) ** 2


def _is_place(amounts: Amounts, term: Term) -> bool:
    try:
        amounts.point(term)
    except NoAmount:
        return False
    return True
