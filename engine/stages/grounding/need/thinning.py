"""Problems without the objects that play no part: of objects that are alike, some spare ones stay, and the others go.

The smaller problem says what is left as plain facts, so that no rule is evaluated over fewer objects than there are.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace

from cellwright.engine.stages.grounding.initial import initial_state
from cellwright.engine.stages.grounding.need.relevance import relevance
from cellwright.engine.stages.grounding.program import Vocabulary
from cellwright.kb.asp.excerpt import excerpt
from cellwright.kb.asp.statics import evaluated
from cellwright.kb.asp.vocabulary import VIOLATED
from cellwright.kb.model.domain import BUILT_IN_TYPES, NUMERIC_TYPES, Domain
from cellwright.kb.model.likeness import alike, free_objects, most_at_once, names
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import Atom, Function

Named = Callable[[str, int], Iterable[Atom]]  # the static facts of a predicate of an arity
Spares = tuple[tuple[str, ...], ...]  # of each class of objects that are alike those that stay


@dataclass(frozen=True, slots=True)
class Thinned:
    """A problem without some objects that are alike; `spares` are those of each class that are still there."""

    problem: Problem
    left_out: frozenset[str] = frozenset()
    spares: Spares = ()


def thinned(problem: Problem, statics: Named | None = None, few: Problem | None = None) -> Thinned:
    """The problem without objects that play no part, from its initial state.

    It is the same problem if there are no such objects, or if grounding has to report something. `statics` gives the
    evaluated static facts, and `few` the excerpt of the problem, if they are known already.
    """
    few = few or excerpt(problem)
    found = _thinned(few, statics if few is problem else None)
    if found is None:
        return Thinned(problem)
    return replace(found, left_out=found.left_out | (problem.objects.keys() - few.objects.keys()))


def _thinned(problem: Problem, statics: Named | None) -> Thinned | None:
    free, most = _plentiful(problem)
    if not free:
        return None
    named, state = _started(problem, statics)
    if state is None or any(True for _ in named(VIOLATED, 1)):
        return None
    needed = relevance(problem)
    facts = [fact for name, arity in sorted(needed.static_predicates) for fact in named(name, arity)]
    read = (fact for fact in facts if needed.reads(fact))
    classes = alike(free, (*read, *(atom for atom in state if needed.concerns(atom))))
    spares = tuple(each[: most[free[each[0]]]] for each in classes)
    gone = frozenset(name for own, kept in zip(classes, spares, strict=True) for name in own[len(kept) :])
    return Thinned(_without(problem, gone, facts, state, named), gone, spares) if gone else None


def _plentiful(problem: Problem) -> tuple[dict[str, str], dict[str, int]]:
    """The free objects, with their types, of which there are more than can matter at once; and how many that are, by type.

    Objects of the other types all stay, so what a fact says about one of them ties nothing.
    """
    free = free_objects(problem)
    most = {type_: 1 + most_at_once(problem.domain, type_) for type_ in set(free.values())}
    counts = Counter(free.values())
    return {name: type_ for name, type_ in free.items() if counts[type_] > most[type_]}, most


def _started(problem: Problem, statics: Named | None) -> tuple[Named, tuple[Atom, ...] | None]:
    """The static facts, unless they are known, and the initial state; None for facts that contradict each other."""
    state, contradicted = initial_state(problem, Vocabulary(problem.domain))

    def named(name: str, arity: int) -> Iterable[Atom]:
        return evaluated(problem).facts(name, arity)

    return statics or named, None if contradicted else state


def _without(
    problem: Problem, gone: frozenset[str], facts: Iterable[Atom], state: Iterable[Atom], named: Named
) -> Problem:
    """The problem without some objects, with all its static facts evaluated."""
    domain = problem.domain
    words = domain.conventions
    ways = (*named(words.position, 4), *named(words.travel, 3))
    given = [*facts, *ways, *problem.statics, *_numbered_terms(domain, named)]
    staying = _Staying(gone)
    return replace(
        problem,
        domain=replace(domain, asp=(), objects=staying.objects(domain.objects)),
        objects=staying.objects(problem.objects),
        statics=tuple(dict.fromkeys(fact for fact in given if staying.fact(fact))),
        initial=tuple(atom for atom in state if staying.fact(atom)),
        complete=True,
    )


@dataclass(frozen=True, slots=True)
class _Staying:
    gone: frozenset[str]

    def fact(self, atom: Atom) -> bool:
        return self.gone.isdisjoint(names(atom))

    def objects(self, types: Mapping[str, str]) -> dict[str, str]:
        return {name: type_ for name, type_ in types.items() if name not in self.gone}


def _numbered_terms(domain: Domain, named: Named) -> Iterable[Atom]:
    """Which terms with numbers in them have which type: facts and rules of the problem say so."""
    if any(
        argument in NUMERIC_TYPES for function in domain.functions.values() for argument in function.arguments
    ):
        for type_ in domain.types:
            if type_ not in BUILT_IN_TYPES:
                for fact in named(type_, 1):
                    if isinstance(fact.arguments[0], Function) and fact.arguments[0].arguments:
                        yield fact
