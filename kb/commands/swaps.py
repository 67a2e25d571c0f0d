"""Swaps: "swap probes 1 and 3" puts each of two objects where the other one is at the start.

A place is what a fluent says of an object that no other object can be said to take as well. Where
the objects are follows from the given facts and the defaults.
"""

from collections.abc import Iterator, Mapping

from cellwright.kb.asp.static_facts import evaluate_statics
from cellwright.kb.asp.static_program import type_guard
from cellwright.kb.commands.exclusion import Exclusion
from cellwright.kb.commands.phrase_meanings import PhraseMeaning, slots_of
from cellwright.kb.commands.phrase_patterns import read_pattern
from cellwright.kb.model.conditions import Literal
from cellwright.kb.model.domain_model import Domain, Kind, Operator, Phrase
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Atom, Function, Term, Variable, match_term, term_variables

_VERBS = "(swap|exchange|interchange|switch|trade)"
_SAYINGS = (
    f"{_VERBS} {{A:TYPE}} [around|over]",
    f"{_VERBS} {{A:TYPE}} (with|for|against) {{B:TYPE}}",
    f"{_VERBS} (places|positions) of {{A:TYPE}}",
    "(let|have|make) {A:TYPE} (swap|exchange|change|switch|trade) (places|positions)",
    "{A:TYPE} (swap|exchange|change|switch|trade) (places|positions)",
)


def swap_meanings(domain: Domain) -> list[PhraseMeaning]:
    """Phrases for a swap of two objects of each type that takes places, one fluent for each type.

    The condition of such a phrase says of an object that it is at some place.
    """
    meanings = list[PhraseMeaning]()
    types = set[str]()
    for name, type_ in place_fluents(domain):
        if type_ not in types:
            types.add(type_)
            goal = Literal(Function(name, (Variable("A"), Variable("Place"))))
            for saying in _SAYINGS:
                phrase = Phrase(saying.replace("TYPE", type_), goal=str(goal))
                pattern = read_pattern(phrase.say)
                meanings.append(
                    PhraseMeaning(phrase, pattern, slots_of(pattern), (goal,), swap=True)
                )
    return meanings


def place_fluents(domain: Domain) -> Iterator[tuple[str, str]]:
    """The fluents that say where an object is, each with the type of the object."""
    for predicate in domain.predicates.values():
        if predicate.kind is Kind.FLUENT and len(predicate.arguments) == 2:
            thing, place = Variable("Thing_"), Variable("Place_")
            if _takes_up(domain, Function(predicate.name, (thing, place))):
                yield predicate.name, predicate.arguments[0]


def _takes_up(domain: Domain, atom: Atom) -> bool:
    """Whether an atom of a thing and a place makes something false that is about the place alone,
    or about another thing there.
    """
    return any(_denies_room(domain, atom)) or any(
        _deletes_room(operator, atom.name) for operator in domain.operators
    )


def _denies_room(domain: Domain, atom: Atom) -> Iterator[bool]:
    for rule in domain.deductive_operators:
        trigger = rule.trigger.atom
        if rule.trigger.positive and trigger.name == atom.name and len(trigger.arguments) == 2:
            for consequence in rule.consequences:
                if not consequence.implied:
                    yield _is_room(trigger, consequence.atom)


def _deletes_room(operator: Operator, name: str) -> bool:
    added = [e.atom for e in operator.effects if e.adds and e.atom.name == name]
    deleted = [e.atom for e in operator.effects if not e.adds]
    return any(_is_room(own, room) for own in added for room in deleted)


def _is_room(atom: Atom, denied: Atom) -> bool:
    """Whether a denied atom speaks of the place of an atom, and not of its thing."""
    thing, place = (set(term_variables(argument)) for argument in atom.arguments)
    named = set(term_variables(denied))
    return bool(place) and place <= named and not thing & named


class StartPlaces:
    """Where objects are at the start, by a fluent of a thing and a place."""

    def __init__(self, problem: Problem, objects: Mapping[str, str]) -> None:
        self.problem = problem
        self.exclusion = Exclusion(problem.domain, objects, problem.statics)
        self._known: dict[str, list[Atom]] = {}

    def of(self, thing: Term, fluent: str) -> Term | None:
        """The place of a thing; None if none or several are known."""
        if fluent not in self._known:
            self._known[fluent] = self._facts(fluent)
        pattern = Function(fluent, (thing, Variable("Place_")))
        places = [
            bindings[Variable("Place_")]
            for fact in self._known[fluent]
            if (bindings := match_term(pattern, fact, {})) is not None
        ]
        return places[0] if len(places) == 1 else None

    def _facts(self, fluent: str) -> list[Atom]:
        """The facts of a fluent that hold at the start: given ones, then defaults that no earlier
        one excludes.
        """
        facts = list(dict.fromkeys(self.problem.initial))
        for atom in self._defaults(fluent) if not self.problem.complete else ():
            one = Literal(atom)
            if not any(self.exclusion.apart(one, Literal(fact)) for fact in facts):
                facts.append(atom)
        return [fact for fact in dict.fromkeys(facts) if fact.name == fluent]

    def _defaults(self, fluent: str) -> Iterator[Atom]:
        """The instances of the defaults of a fluent, in their order."""
        own = [each for each in self.problem.domain.defaults if each.atom.name == fluent]
        rules = list[str]()
        for number, default in enumerate(own):
            head = Function(f"_start_{number}", default.atom.arguments)
            body = dict.fromkeys([*type_guard(default.parameters), *map(str, default.body)])
            rules.append(f"{head} :- {', '.join(body)}." if body else f"{head}.")
        grounder = evaluate_statics(self.problem, rules)
        for number, default in enumerate(own):
            instances = grounder.atoms(f"_start_{number}", len(default.atom.arguments))
            yield from (Function(fluent, arguments) for arguments in sorted(instances, key=str))
