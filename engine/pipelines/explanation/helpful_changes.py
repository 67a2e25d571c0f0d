"""Searches the smallest changes that give a problem a plan; alike objects are tried once.

Two objects may only be alike together with others: a tube, and the seat where it belongs. So what
changes places is found from two objects on, and then proved: every fact stays true.
"""

import itertools
import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

from cellwright.engine.model.outcome import Found, GaveUp, Outcome
from cellwright.engine.model.plan_explanation import Amendment, Edit
from cellwright.engine.pipelines.explanation.amendments import (
    INITIAL,
    OBJECT,
    STATIC,
    apply_amendment,
    terms_within,
)
from cellwright.engine.pipelines.explanation.candidate_edits import (
    EditCandidate,
    joint_edits,
    single_edits,
)
from cellwright.engine.pipelines.explanation.possible_facts import ProblemSpace
from cellwright.engine.pipelines.explanation.standing_obstacles import barred_thing, obstacle_of
from cellwright.kb.asp.static_facts import evaluate_statics
from cellwright.kb.model.conditions import Exists, Literal, goal_parts
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import (
    ANYTHING,
    Atom,
    Function,
    Number,
    Term,
    exchange_subterms,
    match_term,
    stage_parts,
    substitute_atom,
)

MAX_COMPARED_PAIRS = 2_000_000  # facts times pairs of objects; above this nothing is looked for
MAX_EDIT_IMAGES = 500  # of one edit
REGARDED_OBJECT = Function("*")  # stands for the object that is looked at

Swap = Mapping[Term, Term]


class AlikeObjects:
    """Which edits of a problem are the same but for the names of alike objects."""

    def __init__(self, space: ProblemSpace) -> None:
        problem, domain = space.problem, space.problem.domain
        parts_of_domain = (
            domain.operators,
            domain.deductive_operators,
            domain.defaults,
            domain.rules,
        )
        texts = [
            repr(parts_of_domain),
            repr(problem.goal),
            repr((domain.quantities, problem.durations)),
            *map(str, (s for c in problem.chains for s in c.stages)),
        ]
        named = set(
            re.findall(r"[a-z]\w*", "\n".join([*texts, *(rule.text for rule in domain.asp)]))
        )
        types = {**domain.objects, **problem.objects}
        self.types = {Function(name): type_ for name, type_ in types.items() if name not in named}
        self.facts = frozenset((*problem.statics, *problem.initial))
        self.about: dict[Term, list[Atom]] = defaultdict(list)
        for fact in sorted(self.facts, key=str):
            for named_object in self._things(fact):
                self.about[named_object].append(fact)
        self.swaps = tuple(self._swaps())

    def images(self, edit: Edit) -> set[Edit]:
        """The edits that alike objects make of one, itself included."""
        images, waiting = {edit}, [edit]
        while waiting and len(images) < MAX_EDIT_IMAGES:
            last = waiting.pop()
            new = {_exchange_edit(last, swap) for swap in self.swaps} - images
            images |= new
            waiting += new
        return images

    def _things(self, fact: Term) -> dict[Function, None]:
        """The objects in a fact that nothing but facts names."""
        inner = (subterm for subterm in terms_within(fact) if isinstance(subterm, Function))
        return dict.fromkeys(inner_term for inner_term in inner if inner_term in self.types)

    def _swaps(self) -> Iterator[Swap]:
        """What changes places with what, for neighbours among objects of which the same is said."""
        groups: dict[tuple[object, ...], list[Function]] = defaultdict(list)
        for typed_object in sorted(self.types, key=str):
            groups[self.types[typed_object], *sorted(self._shapes(typed_object))].append(
                typed_object
            )
        pairs = [pair for group in groups.values() for pair in itertools.pairwise(group)]
        if len(pairs) * len(self.facts) <= MAX_COMPARED_PAIRS:
            for first, second in pairs:
                if (swap := self._completed({first: second, second: first})) is not None:
                    yield swap

    def _shapes(self, typed_object: Function) -> Iterator[str]:
        """What is said of an object, without names of others."""
        for fact in self.about[typed_object]:
            hidden: dict[Term, Term] = {
                named_object: REGARDED_OBJECT if named_object == typed_object else ANYTHING
                for named_object in self._things(fact)
            }
            yield str(exchange_subterms(fact, hidden))

    def _completed(self, swap: dict[Term, Term]) -> Swap | None:
        """A swap with all that has to change places, too, so that every fact stays true; None
        if it cannot be.
        """
        waiting = list(swap)
        while waiting:
            for fact in self.about[waiting.pop()]:
                if exchange_subterms(fact, swap) not in self.facts:
                    more = self._repair(fact, swap)
                    if more is None:
                        return None
                    swap |= more
                    waiting += more
        return (
            swap
            if all(exchange_subterms(fact, swap) in self.facts for fact in self._touched(swap))
            else None
        )

    def _repair(self, fact: Atom, swap: Swap) -> dict[Term, Term] | None:
        """The one pair of objects that has to change places, too, so that what a swap makes of
        a fact is true.
        """
        free = [named_object for named_object in self._things(fact) if named_object not in swap]
        image = exchange_subterms(fact, swap)
        if len(free) != 1:
            return None
        pattern = exchange_subterms(image, {free[0]: REGARDED_OBJECT})
        near = next(named_object for named_object in self._things(image) if named_object in swap)
        fitting = [
            typed_object
            for fact_about in self.about[near]
            for typed_object in self._things(fact_about)
            if typed_object not in swap and self.types[typed_object] == self.types[free[0]]
            if exchange_subterms(fact_about, {typed_object: REGARDED_OBJECT}) == pattern
        ]
        return {free[0]: fitting[0], fitting[0]: free[0]} if len(fitting) == 1 else None

    def _touched(self, swap: Swap) -> Iterable[Atom]:
        return dict.fromkeys(fact for moved_object in swap for fact in self.about[moved_object])


def _exchange_edit(edit: Edit, swap: Swap) -> Edit:
    added, removed = (
        None if fact is None else exchange_subterms(fact, swap)
        for fact in (edit.added, edit.removed)
    )
    assert isinstance(added, Function | None)
    assert isinstance(removed, Function | None)
    return Edit(edit.layer, added, removed)


MAX_SIZE = 3  # facts in one change
MAX_TRIALS = 1_000  # single facts planned with
MAX_JOINT_TRIALS = 60  # sets of several facts planned with, for each size
MAX_JOINT_MODELS = 400
MAX_HALVES = 40  # tries of nearer numbers
MAX_JOINT = 5  # sets of several facts that are enough
# a change is large if it makes so many times as many instances of operators as there are,
LARGE_GROWTH = 3
LARGE_INSTANCE_COUNT = 300  # or as so many are

_EDIT_VERBS = ("remove", "add", "change")  # the order in which they are tried

Planned = Callable[[Problem], Outcome | None]
"""Plans for a variant of the problem; None if the variant contradicts itself."""
Family = tuple[str, str, tuple[Term | None, ...]]
"""Layer, predicate and arguments of a fact, with None for numbers."""


@dataclass
class ChangeSearch:
    """The search for changes that help.

    `untried` counts candidates that a limit kept from being tried.
    """

    space: ProblemSpace
    problem: Problem
    culprits: Sequence[str]  # the goals that cannot be reached, in words
    planned: Planned
    interrupted: Callable[[], bool]
    untried: int = field(default=0)
    found: list[tuple[Amendment, Found]] = field(default_factory=list)
    _families: set[Family] = field(default_factory=set)
    _removed: set[Atom] = field(default_factory=set)
    _barred: set[Function] = field(default_factory=set)  # things of the facts that are in the way
    _vain: set[tuple[Edit, ...]] = field(default_factory=set)
    _implied: list[frozenset[Atom]] = field(default_factory=list)

    def smallest(self) -> list[tuple[Amendment, Found]]:
        """The changes of one fact that help; if there are none, those of two facts, then of three.

        They are tried in tiers, a tier only if nothing before it helps (`_tier`).
        """
        tiers: dict[int, list[EditCandidate]] = defaultdict(list)
        for candidate in single_edits(self.space):
            tiers[self._tier(candidate)].append(candidate)
        for _, candidates in sorted(tiers.items()):
            if not self.found:
                self._single(
                    sorted(
                        candidates, key=lambda candidate_entry: self._rank(candidate_entry.edits[0])
                    )
                )
        for size in range(2, MAX_SIZE + 1):
            if not self.found and not self.interrupted():
                self._joint(
                    sorted(joint_edits(self.space, size, MAX_JOINT_MODELS), key=self._joint_rank)
                )
        return self.found

    def _single(self, candidates: Iterable[EditCandidate]) -> None:
        useless: set[frozenset[str]] = set()
        trials = 0
        for candidate in candidates:
            edit = candidate.edits[0]
            if self._dominated(edit) or candidate.effect in useless:
                continue
            if trials >= MAX_TRIALS or self.interrupted():
                self.untried += 1
                continue
            trials += 1
            replacement = next(
                (
                    replacement
                    for replacement in (*self._instead(edit), edit)
                    if self._try((replacement,))
                ),
                None,
            )
            if replacement is not None:
                self._remember(self._nearer(replacement))
            elif candidate.effect:
                useless.add(candidate.effect)

    def _joint(self, candidates: Iterable[EditCandidate]) -> None:
        serious = (
            candidate for candidate in candidates if not any(map(self.is_goal, candidate.edits))
        )
        for number, candidate in enumerate(serious):
            if number >= MAX_JOINT_TRIALS or len(self.found) >= MAX_JOINT or self.interrupted():
                return
            families = {edit_family(edit) for edit in candidate.edits if edit.added}
            new = not families or not families <= self._families
            if new and self._try(candidate.edits):
                self._families |= families

    def _try(self, edits: tuple[Edit, ...]) -> bool:
        """Plan with a change, unless it is in vain for sure: it was tried in place of an
        addition, or for an object that is alike.
        """
        if edits in self._vain:
            return False
        change = Amendment(edits)
        outcome = self.planned(apply_amendment(self.problem, change))
        if isinstance(outcome, Found):
            self.found.append((change, outcome))
            return True
        if isinstance(outcome, GaveUp):
            self.untried += 1
            self._vain.add(edits)
        elif len(edits) == 1:
            self._vain |= {(image,) for image in self._alike.images(edits[0])}
        return False

    def _nearer(self, edit: Edit) -> Edit:
        """The edit that was found last with the number that is nearest to the old one and
        helps, too, by halves.
        """
        place = _renumbered(edit)
        if place is None or edit.removed is None:
            return edit
        (old, new), best = (_number(each, place) for each in (edit.removed, edit.fact)), edit
        for _ in range(MAX_HALVES):
            middle = (old + new) // 2 if new > old else -((-old - new) // 2)
            if middle in (old, new) or self.interrupted():
                break
            nearer = Edit(edit.layer, _with_number(edit.fact, place, middle), edit.removed)
            if self._try((nearer,)):
                self.found.pop(-2)
                new, best = middle, nearer
            else:
                old = middle
        return best

    @cached_property
    def _alike(self) -> AlikeObjects:
        return AlikeObjects(self.space)

    def _remember(self, edit: Edit) -> None:
        if edit.added is not None:
            self._families.add(edit_family(edit))
        elif edit.removed is not None:
            self._removed.add(edit.removed)
            if (fact := obstacle_of(edit)) and (thing := barred_thing(self.problem, fact)):
                self._barred.add(thing)
        if edit.layer != INITIAL:
            grounder = evaluate_statics(apply_amendment(self.problem, Amendment((edit,))))
            self._implied.append(frozenset(grounder.everything()))

    def _dominated(self, edit: Edit) -> bool:
        """Whether what was found says as much: another number, less than a replacement, or what
        implies the fact.

        Another number in place of one that could also be removed is worth telling: it says how far
        to go.
        """
        if edit.added is not None and edit_family(edit) in self._families:
            return True
        if edit.verb == "change" and edit.removed in self._removed and not _is_renumbering(edit):
            return True
        if self._barred and self._evades(edit):
            return True
        return self._computed(edit) and any(
            edit.added in implied_facts for implied_facts in self._implied
        )

    def _evades(self, edit: Edit) -> bool:
        """Whether an edit only evades a fact that is in the way: it says of the same thing that it
        is at hand, or that the goals' things need something else.
        """
        added = edit.added
        if added is None or edit.layer == OBJECT or _is_renumbering(edit):
            return False
        if self._barred & {term for term in terms_within(added) if isinstance(term, Function)}:
            return True
        known_objects = {*self.problem.objects, *self.problem.domain.objects}
        wanted_things = _words_in(" ".join(self.culprits)) & known_objects & _words_in(str(added))
        others = {each.removed for each in self._replacements(Edit(edit.layer, added))}
        return edit.layer == STATIC and any(
            wanted_things & _words_in(str(fact)) for fact in {*others, edit.removed} - {None}
        )

    def _computed(self, edit: Edit) -> bool:
        return edit.layer == STATIC and edit.fact.name in self.space.computed

    def _instead(self, edit: Edit) -> Iterator[Edit]:
        """The replacements of an addition that nothing found says as much as."""
        yield from (instead for instead in self._replacements(edit) if not self._dominated(instead))

    def _replacements(self, edit: Edit) -> Iterator[Edit]:
        """Where a fact has one value for each of its other arguments, the new value takes the
        place of the old.
        """
        if edit.verb != "add" or edit.layer == OBJECT:
            return
        facts = self.space.problem.statics if edit.layer == STATIC else self.problem.initial
        alike = [fact for fact in facts if fact.name == edit.fact.name]
        for place in range(len(edit.fact.arguments) if len(edit.fact.arguments) > 1 else 0):
            keys = [(*fact.arguments[:place], *fact.arguments[place + 1 :]) for fact in alike]
            own = (*edit.fact.arguments[:place], *edit.fact.arguments[place + 1 :])
            if own in keys and len(set(keys)) == len(keys):
                yield Edit(edit.layer, edit.fact, alike[keys.index(own)])

    def _rank(self, edit: Edit) -> tuple[object, ...]:
        """First what speaks of the goals' things, then the nearest number."""
        words = _words_in(" ".join(self.culprits))
        edit_words = _words_in(" ".join(map(str, filter(None, (edit.added, edit.removed)))))
        place = edit.layer == OBJECT
        return (
            place,
            _EDIT_VERBS.index(edit.verb),
            -len(words & edit_words),
            str(edit_family(edit)),
            self._distance(edit),
            any(number < 0 for number in _fact_numbers(edit.fact)),
            str(edit),
        )

    def _tier(self, candidate: EditCandidate) -> int:
        """Plain facts come first. Then come facts that rules compute but people give, too, objects
        of another type, facts that rules alone compute, what makes the problem many times as large,
        and goals that hold from the start.
        """
        edit = candidate.edits[0]
        if self.is_goal(edit):
            return 5
        if len(candidate.effect) > LARGE_GROWTH * max(self.space.size, LARGE_INSTANCE_COUNT):
            return 4
        if self._computed(edit):
            return 1 if edit.fact.name in self.space.given else 3
        return 2 if edit.layer == OBJECT and edit.verb == "change" else 0

    def _joint_rank(self, candidate: EditCandidate) -> tuple[object, ...]:
        initial = sum(edit.layer == INITIAL for edit in candidate.edits)
        return (initial, *zip(*map(self._rank, candidate.edits), strict=True))

    def _distance(self, edit: Edit) -> int:
        """How far the numbers of a new fact are from those that are given for the same things;
        else their size.
        """
        numbers = _fact_numbers(edit.fact)
        facts = (*self.space.problem.statics, *self.problem.initial)
        known_numbers = [
            _fact_numbers(f) for f in facts if edit_family(Edit(edit.layer, f)) == edit_family(edit)
        ] or [[0] * len(numbers)]
        return min(
            sum(abs(a - b) for a, b in zip(numbers, own, strict=True)) for own in known_numbers
        )

    def is_goal(self, edit: Edit) -> bool:
        """Whether the edit does no more than to claim that a goal is already reached."""
        added = edit.added
        if edit.layer != INITIAL or added is None:
            return False
        wanted_atoms = [
            *goal_atoms(self.problem),
            *(
                part
                for chain in self.problem.chains
                for stage in chain.stages
                for part in stage_parts(stage)
            ),
        ]
        return any(match_term(goal_atom, added, {}) is not None for goal_atom in wanted_atoms)


def goal_atoms(problem: Problem) -> Iterator[Atom]:
    """The atoms that goals ask for, with `_` where any value will do."""
    for part in goal_parts(problem.goal):
        bound = {p.variable: ANYTHING for p in part.parameters} if isinstance(part, Exists) else {}
        inner = part.part if isinstance(part, Exists) else part
        if isinstance(inner, Literal) and inner.positive:
            yield substitute_atom(inner.atom, bound)


def edit_family(edit: Edit) -> Family:
    """What edits have in common that give the same fact with other numbers, be it added or in
    place of another.
    """
    return (
        edit.layer,
        edit.fact.name,
        tuple(
            None if isinstance(argument, Number) else argument for argument in edit.fact.arguments
        ),
    )


def _is_renumbering(edit: Edit) -> bool:
    """Whether a fact stands in place of the same one with another number."""
    return edit.removed is not None and edit_family(edit) == edit_family(
        Edit(edit.layer, edit.removed)
    )


def _renumbered(edit: Edit) -> int | None:
    """The only argument in which a new number stands in place of an old one."""
    if not _is_renumbering(edit) or edit.removed is None:
        return None
    pairs = zip(edit.fact.arguments, edit.removed.arguments, strict=True)
    places = [place for place, (new, old) in enumerate(pairs) if new != old]
    return places[0] if len(places) == 1 else None


def _number(fact: Atom, place: int) -> int:
    number = fact.arguments[place]
    assert isinstance(number, Number)
    return number.value


def _with_number(fact: Atom, place: int, value: int) -> Atom:
    return Function(
        fact.name, (*fact.arguments[:place], Number(value), *fact.arguments[place + 1 :])
    )


def _fact_numbers(fact: Atom) -> list[int]:
    return [argument.value for argument in fact.arguments if isinstance(argument, Number)]


def _words_in(text: str) -> set[str]:
    return set(re.findall(r"[a-z]\w*", text))
