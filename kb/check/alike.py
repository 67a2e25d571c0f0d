"""Large problems with few objects: of those that are alike, a few stand for all.

Two objects are alike if they have the same type, and the same is said about them by all static facts (also those that rules
derive), initial facts and goals, except for numbers and for each other's names. What can be reached with one of them can be
reached with the other, unless rules of operators compare their numbers.
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

from cellwright.kb.asp.statics import evaluated
from cellwright.kb.model.conditions import And, goal_parts
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import Atom, Function, Term

MANY = 150  # objects of a problem; with fewer it is left as it is
EACH = 3  # objects that stand for those like them
WORD = re.compile(r"\w+")
NUMBER = re.compile(r"-?\b\d+\b")


@dataclass(frozen=True, slots=True)
class Fewer:
    """A problem with fewer objects. `stands_for` names for each object that was left out one that is alike."""

    problem: Problem
    stands_for: Mapping[str, str]

    def told_of_all(self, atoms: Iterable[Atom]) -> set[Atom]:
        """The atoms, and those about the objects that were left out instead of the ones that stand for them."""
        found = set(atoms)
        like: dict[str, list[str]] = {}
        for name, other in self.stands_for.items():
            like.setdefault(other, []).append(name)
        for atom in tuple(found) if like else ():
            named = [name for name in dict.fromkeys(WORD.findall(str(atom))) if name in like]
            if len(named) == 1:
                found |= {_renamed(atom, named[0], name) for name in like[named[0]]}
        return found


def fewer(problem: Problem) -> Fewer:
    """The problem without objects that are like others, if it has many objects and no workflow."""
    if len(problem.objects) <= MANY or problem.chains:
        return Fewer(problem, {})
    groups: dict[tuple[str, frozenset[str]], list[str]] = {}
    for name, said in _said(problem).items():
        groups.setdefault((problem.objects[name], frozenset(said)), []).append(name)
    named = {word for fact in problem.initial for word in WORD.findall(str(fact))}
    stands_for = {name: names[0] for names in groups.values() for name in names[EACH:] if name not in named}
    return Fewer(_without(problem, stands_for), stands_for)


def _said(problem: Problem) -> dict[str, set[str]]:
    """What is said about each object of a problem, with other objects and numbers masked."""
    grounder = evaluated(problem)
    texts = (
        *map(str, grounder.everything()),
        *map(str, problem.initial),
        *map(str, goal_parts(problem.goal)),
    )
    found: dict[str, set[str]] = {name: set() for name in problem.objects}
    for text in texts:
        own = {word for word in WORD.findall(text) if word in found}
        masked = NUMBER.sub("0", text)
        for name in own:
            found[name].add(WORD.sub(lambda word: _mask(word[0], name, own), masked))  # noqa: B023 - used at once
    return found


def _mask(word: str, name: str, own: set[str]) -> str:
    return "_own" if word == name else "_other" if word in own else word


def _without(problem: Problem, left_out: Mapping[str, str]) -> Problem:
    """The problem without objects, and without the facts and goals that name them."""

    def kept(text: str) -> bool:
        return not any(word in left_out for word in WORD.findall(text))

    return replace(
        problem,
        objects={name: type_ for name, type_ in problem.objects.items() if name not in left_out},
        statics=tuple(fact for fact in problem.statics if kept(str(fact))),
        goal=And(tuple(part for part in goal_parts(problem.goal) if kept(str(part)))),
    )


def _renamed(term: Atom, old: str, new: str) -> Atom:
    arguments: tuple[Term, ...] = tuple(
        _renamed(each, old, new) if isinstance(each, Function) else each for each in term.arguments
    )
    return Function(new if term.name == old and not arguments else term.name, arguments)
