"""Reduces large problems: of objects that are alike, a few stand for all.

Two objects are alike if they have the same type, and the same is said about them by all static
facts (also those that rules derive), initial facts and goals, except for numbers and for each
other's names. What can be reached with one of them can be reached with the other, unless rules of
operators compare their numbers.
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

from cellwright.kb.asp.static_facts import evaluate_statics
from cellwright.kb.model.conditions import And, goal_parts
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Atom, Function, Term

MANY_OBJECTS = 150  # objects of a problem; with fewer it is left as it is
KEPT_PER_CLASS = 3  # objects that stand for those like them
NAME_WORD = re.compile(r"\w+")
NUMBER_WORD = re.compile(r"-?\b\d+\b")


@dataclass(frozen=True, slots=True)
class ReducedProblem:
    """A problem with fewer objects.

    `stands_for` names for each object that was left out one that is alike.
    """

    problem: Problem
    stands_for: Mapping[str, str]

    def told_of_all(self, atoms: Iterable[Atom]) -> set[Atom]:
        """The atoms, and those about the objects that were left out instead of the ones that
        stand for them.
        """
        atoms_of_all = set(atoms)
        like: dict[str, list[str]] = {}
        for name, stand_in in self.stands_for.items():
            like.setdefault(stand_in, []).append(name)
        for atom in tuple(atoms_of_all) if like else ():
            named = [name for name in dict.fromkeys(NAME_WORD.findall(str(atom))) if name in like]
            if len(named) == 1:
                atoms_of_all |= {_rename_object(atom, named[0], name) for name in like[named[0]]}
        return atoms_of_all


def reduce_objects(problem: Problem) -> ReducedProblem:
    """The problem without objects that are like others, if it has many objects and no workflow."""
    if len(problem.objects) <= MANY_OBJECTS or problem.chains:
        return ReducedProblem(problem, {})
    groups: dict[tuple[str, frozenset[str]], list[str]] = {}
    for name, object_texts in _object_descriptions(problem).items():
        groups.setdefault((problem.objects[name], frozenset(object_texts)), []).append(name)
    named = {word for fact in problem.initial for word in NAME_WORD.findall(str(fact))}
    stands_for = {
        name: names[0]
        for names in groups.values()
        for name in names[KEPT_PER_CLASS:]
        if name not in named
    }
    return ReducedProblem(_problem_without(problem, stands_for), stands_for)


def _object_descriptions(problem: Problem) -> dict[str, set[str]]:
    """What is said about each object of a problem, with other objects and numbers masked."""
    grounder = evaluate_statics(problem)
    texts = (
        *map(str, grounder.everything()),
        *map(str, problem.initial),
        *map(str, goal_parts(problem.goal)),
    )
    descriptions: dict[str, set[str]] = {name: set() for name in problem.objects}
    for text in texts:
        own = {word for word in NAME_WORD.findall(text) if word in descriptions}
        masked = NUMBER_WORD.sub("0", text)
        for name in own:
            descriptions[name].add(
                NAME_WORD.sub(lambda word: _mask_word(word[0], name, own), masked)  # noqa: B023
            )
    return descriptions


def _mask_word(word: str, name: str, own: set[str]) -> str:
    return "_own" if word == name else "_other" if word in own else word


def _problem_without(problem: Problem, left_out: Mapping[str, str]) -> Problem:
    """The problem without objects, and without the facts and goals that name them."""

    def is_kept(text: str) -> bool:
        return not any(word in left_out for word in NAME_WORD.findall(text))

    return replace(
        problem,
        objects={name: type_ for name, type_ in problem.objects.items() if name not in left_out},
        statics=tuple(fact for fact in problem.statics if is_kept(str(fact))),
        goal=And(tuple(part for part in goal_parts(problem.goal) if is_kept(str(part)))),
    )


def _rename_object(term: Atom, old: str, new: str) -> Atom:
    arguments: tuple[Term, ...] = tuple(
        _rename_object(argument, old, new) if isinstance(argument, Function) else argument
        for argument in term.arguments
    )
    return Function(new if term.name == old and not arguments else term.name, arguments)
