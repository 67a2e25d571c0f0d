"""Initial state of a problem: given facts with their consequences, then each default that fits."""

import re
from collections.abc import Iterable, Iterator

from cellwright.engine.kernels.bits import Bits, bitset
from cellwright.engine.stages.grounding.atom_deduction import Deduction, build_deduction
from cellwright.engine.stages.grounding.grounding_program import (
    ChangingPredicates,
    consequence_body,
    deduction_rules,
    reachable_literal,
    rule_text,
)
from cellwright.engine.stages.grounding.numbered_atoms import Universe
from cellwright.kb.asp import Grounder
from cellwright.kb.asp.static_facts import evaluate_statics, ground_statics
from cellwright.kb.asp.static_program import type_guard
from cellwright.kb.diagnostics import Diagnostic
from cellwright.kb.model.domain_model import BUILT_IN_TYPES, Domain
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Atom, Function, Number

STRANGE_PREDICATE = "_strange"
PLAIN_NAME_PATTERN = re.compile(r"[a-z_]\w*")


def initial_state(
    problem: Problem, vocabulary: ChangingPredicates
) -> tuple[tuple[Atom, ...], list[Diagnostic]]:
    """The fluents that are true at the beginning, and what is wrong with the given facts.

    A fact is wrong if an argument is not a value of its type, or if other facts deny it.
    """
    if problem.complete:
        return tuple(dict.fromkeys(problem.initial)), []
    grounder, program = Grounder(), _initial_program(problem)
    ground_statics(grounder, problem, program, _names_read(problem.domain, program))
    universe = Universe(grounder, vocabulary, {})
    state = _State(build_deduction(problem.domain, vocabulary, universe))
    state.give(bitset([universe.index[fact] for fact in problem.initial]))
    wrong = [
        *_report_strange_arguments(problem, grounder),
        *_report_contradiction(problem, universe.names(state.facts & state.denied)),
    ]
    for number, default in enumerate(problem.domain.defaults):
        default_atoms = grounder.atoms(f"_d_{number}", len(default.atom.arguments))
        for atom in sorted(
            (Function(default.atom.name, arguments) for arguments in default_atoms), key=str
        ):
            state.suppose(universe.index[atom])
    return universe.names(state.facts), wrong


def default_instances(problem: Problem) -> tuple[Atom, ...]:
    """Every instance of every default, also those that other facts exclude."""
    if problem.complete:
        return ()
    grounder = evaluate_statics(problem, _initial_program(problem))
    return tuple(
        Function(default.atom.name, arguments)
        for number, default in enumerate(problem.domain.defaults)
        for arguments in sorted(
            grounder.atoms(f"_d_{number}", len(default.atom.arguments)), key=str
        )
    )


def _report_strange_arguments(problem: Problem, grounder: Grounder) -> Iterator[Diagnostic]:
    """Diagnostics for arguments of given facts that are not values of their types.

    Only the static rules decide which values such a type has, so clingo has to evaluate them first.
    """
    for number, place in sorted(grounder.atoms(STRANGE_PREDICATE, 2), key=str):
        assert isinstance(number, Number)
        assert isinstance(place, Number)
        fact = problem.initial[number.value]
        type_ = problem.domain.predicates[fact.name].arguments[place.value]
        message = f"{fact.arguments[place.value]} is no {type_}, in the initial {fact}"
        yield Diagnostic(
            problem.where,
            "K103",
            message,
            f"change this fact, or the facts that define the type {type_}",
        )


def _report_contradiction(problem: Problem, denied: tuple[Atom, ...]) -> list[Diagnostic]:
    if not denied:
        return []
    message = f"the initial facts deny {', '.join(map(str, denied))}"
    return [
        Diagnostic(
            problem.where, "K301", message, "remove one of the facts that exclude each other"
        )
    ]


def _names_read(domain: Domain, program: Iterable[str]) -> set[str]:
    """The names in a program and in all that is deduced from initial facts: other static facts
    have no say in it.
    """
    bodies = (
        text
        for operator in domain.deductive_operators
        for consequence in operator.consequences
        for text in consequence_body(operator, consequence)
    )
    return {name for text in (*program, *bodies) for name in PLAIN_NAME_PATTERN.findall(text)}


def _initial_program(problem: Problem) -> list[str]:
    text = [
        *(f"{reachable_literal(fact)}." for fact in problem.initial),
        f"#defined {STRANGE_PREDICATE}/2.",
    ]
    for number, fact in enumerate(problem.initial):
        predicate = problem.domain.predicates.get(fact.name)
        for place, type_ in enumerate(predicate.arguments if predicate else ()):
            if type_ not in BUILT_IN_TYPES:
                text.append(
                    f"{STRANGE_PREDICATE}({number},{place}) :- not "
                    f"{type_}({fact.arguments[place]})."
                )
    for number, default in enumerate(problem.domain.defaults):
        body = [*type_guard(default.parameters), *map(str, default.body)]
        text.append(rule_text(str(Function(f"_d_{number}", default.atom.arguments)), body))
        text.append(rule_text(reachable_literal(default.atom), body))
    return text + [
        line
        for operator in problem.domain.deductive_operators
        for line in deduction_rules(operator)
    ]


class _State:
    """The facts that hold so far, and the atoms that they deny."""

    def __init__(self, deduced: Deduction) -> None:
        self.deduced = deduced
        self.facts = self.denied = 0

    def give(self, facts: Bits) -> None:
        """Takes the given facts and everything that follows from them."""
        self.facts, self.denied = self.deduced.close(facts, facts)

    def suppose(self, atom: int) -> None:
        """Adds a default and everything that follows from it, unless it contradicts the state."""
        added, denied = self.deduced.close(1 << atom, self.facts)
        if not (added & self.denied or denied & self.facts or added & denied):
            self.facts |= added
            self.denied |= denied
