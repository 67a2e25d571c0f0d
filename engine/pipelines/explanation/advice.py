"""The smallest changes that give a problem a plan: candidates in order of evidence, each proved by planning."""

import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property

from cellwright.engine.model.explanation import Amendment, Edit
from cellwright.engine.model.outcome import Found, GaveUp, Outcome
from cellwright.engine.pipelines.explanation.alike import Alike
from cellwright.engine.pipelines.explanation.amendments import INITIAL, OBJECT, STATIC, changed
from cellwright.engine.pipelines.explanation.candidates import Candidate, joint_edits, single_edits
from cellwright.engine.pipelines.explanation.space import Space
from cellwright.kb.asp.statics import evaluated
from cellwright.kb.model.conditions import Exists, Literal, goal_parts
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import ANYTHING, Atom, Number, Term, match, parts_of, substitute_atom

MAX_SIZE = 3  # facts in one change
MAX_TRIALS = 1_000  # single facts planned with
MAX_JOINT_TRIALS = 60  # sets of several facts planned with, for each size
MAX_JOINT_MODELS = 400
MAX_JOINT = 5  # sets of several facts that are enough
LARGE = 3  # a change is large if it makes so many times as many instances of operators as there are,
FEW = 300  # or as so many are

_VERBS = ("remove", "add", "change")  # the order in which they are tried

Planned = Callable[[Problem], Outcome | None]
"""Plans for a variant of the problem; None if the variant contradicts itself."""
Family = tuple[str, str, tuple[Term | None, ...]]
"""Layer, predicate and arguments of a fact, with None for numbers."""


@dataclass
class Advice:
    """The search for changes that help. `untried` counts candidates that a limit kept from being tried."""

    space: Space
    problem: Problem
    culprits: Sequence[str]  # the goals that cannot be reached, in words
    planned: Planned
    interrupted: Callable[[], bool]
    untried: int = field(default=0)
    found: list[tuple[Amendment, Found]] = field(default_factory=list)
    _families: set[Family] = field(default_factory=set)
    _removed: set[Atom] = field(default_factory=set)
    _vain: set[tuple[Edit, ...]] = field(default_factory=set)
    _implied: list[frozenset[Atom]] = field(default_factory=list)

    def smallest(self) -> list[tuple[Amendment, Found]]:
        """The changes of one fact that help; if there are none, those of two facts, then of three.

        They are tried in tiers, a tier only if nothing before it helps (`_tier`).
        """
        tiers: dict[int, list[Candidate]] = defaultdict(list)
        for candidate in single_edits(self.space):
            tiers[self._tier(candidate)].append(candidate)
        for _, candidates in sorted(tiers.items()):
            if not self.found:
                self._single(sorted(candidates, key=lambda each: self._rank(each.edits[0])))
        for size in range(2, MAX_SIZE + 1):
            if not self.found and not self.interrupted():
                self._joint(sorted(joint_edits(self.space, size, MAX_JOINT_MODELS), key=self._joint_rank))
        return self.found

    def _single(self, candidates: Iterable[Candidate]) -> None:
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
            way = next((way for way in (*self._instead(edit), edit) if self._try((way,))), None)
            if way is not None:
                self._remember(way)
            elif candidate.effect:
                useless.add(candidate.effect)

    def _joint(self, candidates: Iterable[Candidate]) -> None:
        serious = (each for each in candidates if not any(map(self.is_goal, each.edits)))
        for number, candidate in enumerate(serious):
            if number >= MAX_JOINT_TRIALS or len(self.found) >= MAX_JOINT or self.interrupted():
                return
            families = {family(each) for each in candidate.edits if each.added}
            new = not families or not families <= self._families
            if new and self._try(candidate.edits):
                self._families |= families

    def _try(self, edits: tuple[Edit, ...]) -> bool:
        """Plan with a change, unless it is in vain for sure: it was tried in place of an addition, or for an object that is alike."""
        if edits in self._vain:
            return False
        change = Amendment(edits)
        outcome = self.planned(changed(self.problem, change))
        if isinstance(outcome, Found):
            self.found.append((change, outcome))
            return True
        if isinstance(outcome, GaveUp):
            self.untried += 1
            self._vain.add(edits)
        elif len(edits) == 1:
            self._vain |= {(each,) for each in self._alike.images(edits[0])}
        return False

    @cached_property
    def _alike(self) -> Alike:
        return Alike(self.space)

    def _remember(self, edit: Edit) -> None:
        if edit.added is not None:
            self._families.add(family(edit))
        elif edit.removed is not None:
            self._removed.add(edit.removed)
        if edit.layer != INITIAL:
            grounder = evaluated(changed(self.problem, Amendment((edit,))))
            self._implied.append(frozenset(grounder.everything()))

    def _dominated(self, edit: Edit) -> bool:
        """Whether what was found says as much: another number, less than a replacement, or what implies the fact.

        Another number in place of one that could also be removed is worth telling: it says how far to go.
        """
        if edit.added is not None and family(edit) in self._families:
            return True
        if edit.verb == "change" and edit.removed in self._removed and not _renumbers(edit):
            return True
        return self._computed(edit) and any(edit.added in held for held in self._implied)

    def _computed(self, edit: Edit) -> bool:
        return edit.layer == STATIC and edit.fact.name in self.space.computed

    def _instead(self, edit: Edit) -> Iterator[Edit]:
        """Where a fact has one value for each of its other arguments, the new value takes the place of the old."""
        if edit.verb != "add" or edit.layer == OBJECT:
            return
        facts = self.space.problem.statics if edit.layer == STATIC else self.problem.initial
        alike = [fact for fact in facts if fact.name == edit.fact.name]
        for place in range(len(edit.fact.arguments) if len(edit.fact.arguments) > 1 else 0):
            keys = [(*fact.arguments[:place], *fact.arguments[place + 1 :]) for fact in alike]
            own = (*edit.fact.arguments[:place], *edit.fact.arguments[place + 1 :])
            if own in keys and len(set(keys)) == len(keys):
                instead = Edit(edit.layer, edit.fact, alike[keys.index(own)])
                if not self._dominated(instead):
                    yield instead

    def _rank(self, edit: Edit) -> tuple[object, ...]:
        """First what speaks of the goals' things, then the nearest number."""
        words = _words(" ".join(self.culprits))
        said = _words(" ".join(map(str, filter(None, (edit.added, edit.removed)))))
        place = edit.layer == OBJECT
        return (
            place,
            _VERBS.index(edit.verb),
            -len(words & said),
            str(family(edit)),
            self._distance(edit),
            any(number < 0 for number in _numbers(edit.fact)),
            str(edit),
        )

    def _tier(self, candidate: Candidate) -> int:
        """Plain facts come first. Then come facts that rules compute but people give, too, objects of another type, facts that
        rules alone compute, what makes the problem many times as large, and goals that hold from the start.
        """
        edit = candidate.edits[0]
        if self.is_goal(edit):
            return 5
        if len(candidate.effect) > LARGE * max(self.space.size, FEW):
            return 4
        if self._computed(edit):
            return 1 if edit.fact.name in self.space.given else 3
        return 2 if edit.layer == OBJECT and edit.verb == "change" else 0

    def _joint_rank(self, candidate: Candidate) -> tuple[object, ...]:
        initial = sum(each.layer == INITIAL for each in candidate.edits)
        return (initial, *zip(*map(self._rank, candidate.edits), strict=True))

    def _distance(self, edit: Edit) -> int:
        """How far the numbers of a new fact are from those that are given for the same things; else their size."""
        numbers = _numbers(edit.fact)
        facts = (*self.space.problem.statics, *self.problem.initial)
        given = [_numbers(f) for f in facts if family(Edit(edit.layer, f)) == family(edit)] or [
            [0] * len(numbers)
        ]
        return min(sum(abs(a - b) for a, b in zip(numbers, own, strict=True)) for own in given)

    def is_goal(self, edit: Edit) -> bool:
        """Whether the edit does no more than to claim that a goal is already reached."""
        added = edit.added
        if edit.layer != INITIAL or added is None:
            return False
        wanted = [
            *goal_atoms(self.problem),
            *(part for chain in self.problem.chains for stage in chain.stages for part in parts_of(stage)),
        ]
        return any(match(each, added, {}) is not None for each in wanted)


def goal_atoms(problem: Problem) -> Iterator[Atom]:
    """The atoms that goals ask for, with `_` where any value will do."""
    for part in goal_parts(problem.goal):
        bound = {p.variable: ANYTHING for p in part.parameters} if isinstance(part, Exists) else {}
        inner = part.part if isinstance(part, Exists) else part
        if isinstance(inner, Literal) and inner.positive:
            yield substitute_atom(inner.atom, bound)


def family(edit: Edit) -> Family:
    """What edits have in common that give the same fact with other numbers, be it added or in place of another."""
    return (
        edit.layer,
        edit.fact.name,
        tuple(None if isinstance(each, Number) else each for each in edit.fact.arguments),
    )


def _renumbers(edit: Edit) -> bool:
    """Whether a fact stands in place of the same one with another number."""
    return edit.removed is not None and family(edit) == family(Edit(edit.layer, edit.removed))


def _numbers(fact: Atom) -> list[int]:
    return [each.value for each in fact.arguments if isinstance(each, Number)]


def _words(text: str) -> set[str]:
    return set(re.findall(r"[a-z]\w*", text))
