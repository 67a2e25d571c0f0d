"""Edits of facts under which all goals come within reach: abduction over the relaxed task in
ASP.
"""

from collections.abc import Collection, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from math import prod

from cellwright.engine.model.plan_explanation import Edit
from cellwright.engine.pipelines.explanation.amendments import INITIAL, OBJECT, STATIC, terms_within
from cellwright.engine.pipelines.explanation.obstacles import Obstacles
from cellwright.engine.pipelines.explanation.parts_of_values import names
from cellwright.engine.pipelines.explanation.possible_facts import ProblemSpace
from cellwright.engine.pipelines.explanation.relaxed_program import (
    LOOSENED_PREDICATE,
    MISSED_PREDICATE,
    denial_rules,
    new_defaults,
    relaxed_rules,
)
from cellwright.engine.stages.grounding.grounding_program import reachable_literal
from cellwright.engine.stages.grounding.pruning import find_relevance
from cellwright.kb.asp.bounded_grounding import GroundingTooLarge
from cellwright.kb.asp.model_search import enumerate_models
from cellwright.kb.asp.static_program import VIOLATED, static_program
from cellwright.kb.asp.trial_grounding import can_be_grounded
from cellwright.kb.model.domain_model import Domain, Kind
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.model.statement import Signature
from cellwright.kb.terms import ANYTHING, Atom, Function, Term, Variable


class GoalBearing:
    """What the goals of a problem can need from the initial state.

    It leaves nothing out that they may need.
    """

    def __init__(self, problem: Problem) -> None:
        self.problem, self.needs = problem, find_relevance(problem)

    def on_goals(self, fact: Atom) -> bool:
        """Whether a fluent or a quantity at the start can matter to any goal.

        `_` stands for any value.
        """
        if fact.name in self.problem.domain.quantities:
            return fact.name in self._asked
        return fact.name in self._deciding or self.needs.concerns(fact)

    @cached_property
    def _deciding(self) -> frozenset[str]:
        """The names of facts from which it follows whether something holds that the goals can
        need: a default, say.
        """
        wanted_names = {want.pattern.name for want in self.needs.wanted}
        deciding = set[str]()
        while (
            more := {
                rule.trigger.atom.name
                for rule in self.problem.domain.deductive_operators
                if (wanted_names | deciding)
                & {consequence.atom.name for consequence in rule.consequences}
            }
            - deciding
        ):
            deciding |= more
        return frozenset(deciding)

    @cached_property
    def _asked(self) -> frozenset[str]:
        """The names that goals, rules and those operators mention which the goals can need."""
        domain = self.problem.domain
        operators = tuple(
            operator for operator in domain.operators if operator.name in self.needs.bindings
        )
        parts = (self.problem.goal, domain.rules, domain.deductive_operators, operators)
        return frozenset(name for part in parts for name in names(part))


MAX_CHOICES = 30_000  # ways to fill the arguments of one predicate
TRIAL_GROUNDING_INSTANCES = 1_000  # more than so many are first grounded on trial
MAX_MODELS = 20_000


@dataclass(frozen=True, slots=True)
class OpenedFacts:
    """What may be different: facts of these static predicates and fluents, and objects."""

    statics: tuple[Signature, ...] = ()
    fluents: tuple[Signature, ...] = ()
    objects: bool = False
    replaced: bool = True  # whether a fact may stand in place of another


@dataclass(frozen=True, slots=True)
class EditCandidate:
    """Edits under which the relaxed task reaches all goals.

    `effect` is what they change for the planner, as texts; candidates with the same effect have the
    same plans. It is empty where facts of the initial state are edited.
    """

    edits: tuple[Edit, ...]
    effect: frozenset[str] = frozenset()


def single_edits(space: ProblemSpace) -> Iterator[EditCandidate]:
    """Every single edit under which the relaxed task reaches all goals, and that changes
    something for it.
    """
    for signature in space.statics:
        yield from _find_candidates(space, OpenedFacts((signature,)), 1)
    yield from _find_candidates(space, OpenedFacts(objects=True), 1)
    bears = GoalBearing(space.problem).on_goals
    for signature in fluent_signatures(space):
        if bears(Function(signature[0], (ANYTHING,) * signature[1])):
            candidates = _find_candidates(space, OpenedFacts(fluents=(signature,)), 1)
            yield from (
                candidate
                for candidate in candidates
                if any(map(bears, _edited_facts(candidate.edits[0])))
            )


def joint_edits(space: ProblemSpace, size: int, limit: int) -> Iterator[EditCandidate]:
    """Sets of `size` facts to add or remove, all of them needed for the relaxed task to reach all
    goals.

    Quantities are not among them: each has one value, so a value is never added.
    """
    if not space.reachable:
        statics = tuple(
            signature for signature in space.statics if signature[0] not in space.computed
        )
        plain = tuple(
            signature
            for signature in fluent_signatures(space)
            if signature[0] not in space.problem.domain.quantities
        )
        yield from _find_candidates(space, OpenedFacts(statics, plain, replaced=False), size, limit)


def fluent_signatures(space: ProblemSpace) -> tuple[Signature, ...]:
    """The fluents of the domain."""
    declared = space.problem.domain.predicates.values()
    return tuple(
        (predicate.name, len(predicate.arguments))
        for predicate in declared
        if predicate.kind is Kind.FLUENT
    )


def _find_candidates(
    space: ProblemSpace, opened: OpenedFacts, size: int, limit: int = MAX_MODELS
) -> Iterator[EditCandidate]:
    choices, obstacles = _EditChoices(space, opened), Obstacles(space.problem)
    text = "\n".join([*choices.lines(), f":- #count {{ F : _assumed(F) }} != {size}."])
    if choices.count > TRIAL_GROUNDING_INSTANCES and not can_be_grounded(text):
        return
    with suppress(GroundingTooLarge):  # what cannot be grounded is not proposed
        for model in enumerate_models(text, "_shown", "edit", limit):
            edits = tuple(
                edit_of_assumption(term.arguments[0], space.problem.domain) for term in model.terms
            )
            if all(map(obstacles.sensible, edits)):
                yield EditCandidate(edits, model.others)


def edit_of_assumption(assumed: Term, domain: Domain) -> Edit:
    """An assumption of the program as an edit."""
    assert isinstance(assumed, Function)
    first, last = assumed.arguments[0], assumed.arguments[-1]
    assert isinstance(first, Function)
    assert isinstance(last, Function)
    layer = OBJECT if first.name in domain.types else STATIC
    if first.name in domain.predicates and domain.predicates[first.name].kind is Kind.FLUENT:
        layer = INITIAL
    match assumed.name:
        case "add":
            return Edit(layer, first)
        case "remove":
            return Edit(layer, None, first)
        case _:
            return Edit(layer, last, first)


class _EditChoices:
    """The program that chooses edits of what is opened, with the relaxed task below them."""

    def __init__(self, space: ProblemSpace, opened: OpenedFacts) -> None:
        self.space, self.opened, self.problem = space, opened, space.problem
        self.count = 0

    def lines(self) -> Iterator[str]:
        """The program; it has one model for each set of edits that will do."""
        problem, opened = self.problem, self.opened
        hidden = {name for name, _ in opened.statics}
        if opened.objects:
            domain = replace(problem.domain, objects={})
            problem = replace(problem, domain=domain, objects={}, statics=())
            hidden = {fact.name for fact in self.problem.statics}
        else:
            kept_statics = tuple(fact for fact in problem.statics if fact.name not in hidden)
            problem = replace(problem, statics=kept_statics)
        yield static_program(problem)
        yield from map(self._starting, self.space.initial)
        yield relaxed_rules(self.problem)
        yield from new_defaults(self.problem, self._defaults())
        yield from (self._given(fact) for fact in self.problem.statics if fact.name in hidden)
        yield "_shown(edit(E)) :- _assumed(E)."
        yield "#defined _gone/1. #defined _lost/1. #defined _assumed/1."
        yield "_gone(F) :- _assumed(remove(F)). _gone(F) :- _assumed(change(F, _))."
        yield f":- {MISSED_PREDICATE}(_). :- {VIOLATED}(_)."
        if opened.objects or any(name in self.space.denying for name, _ in opened.statics):
            yield f"{LOOSENED_PREDICATE} :- _assumed(_)."
        for signature in opened.statics:
            yield from self._facts(signature, self.problem.statics, self.space.rows(signature), "")
        for signature in opened.fluents:
            initial_rows = [
                fact.arguments for fact in self.space.initial if _signature_of(fact) == signature
            ]
            yield from self._facts(signature, self.problem.initial, initial_rows, "_r_")
            yield from self._given_now()
        if opened.objects:
            yield from self._objects()
        if not opened.fluents:
            yield from self._differences()

    def _defaults(self) -> dict[int, Sequence[Atom]]:
        return {
            number: [
                Function("_", row)
                for row in self.space.rows((f"_default_{number}", len(default.atom.arguments)))
            ]
            for number, default in enumerate(self.problem.domain.defaults)
        }

    def _starting(self, atom: Atom) -> str:
        """A fact of the initial state.

        That it may be gone matters to quantities alone: nothing else is ever denied.
        """
        measured = atom.name in self.problem.domain.quantities
        return f"{reachable_literal(atom)}{f' :- not _gone({atom})' if measured else ''}."

    def _given_now(self) -> Iterator[str]:
        """What is given with an edit of the initial state does not contradict itself."""
        yield from (f"_now({fact}) :- not _gone({fact})." for fact in self.problem.initial)
        yield "_now(F) :- _assumed(add(F)). _now(F) :- _assumed(change(_, F)). #defined _now/1."
        yield from denial_rules(self.problem)

    def _given(self, fact: Atom) -> str:
        """A static fact that may be gone, itself or with an object that it mentions."""
        body = [f"not _gone({fact})"]
        if self.opened.objects and fact in self.space.own:
            mentioned = {
                str(subterm) for argument in fact.arguments for subterm in terms_within(argument)
            }
            body += [
                f"not _lost({name})" for name in sorted(mentioned & set(object_types(self.space)))
            ]
        return f"{fact} :- {', '.join(body)}."

    def _facts(
        self,
        signature: Signature,
        facts: Collection[Atom],
        held_rows: Collection[tuple[Term, ...]],
        prefix: str,
    ) -> Iterator[str]:
        """The choices among facts of one predicate that may be added, removed or replaced."""
        name, arity = signature
        own = [fact for fact in facts if _signature_of(fact) == signature]
        values = self.space.arguments(signature)
        variables = tuple(Variable(f"X{place}") for place in range(arity))
        atom, other_value = Function(name, variables), Variable("Y")
        domain = f"_dom_{name}_{arity}"
        for place, term in enumerate(values):
            yield from (f"{domain}({place}, {value})." for value in term)
        yield (
            f"#defined {domain}/2. #defined _given_{arity}_{name}/1. #defined "
            f"_held_{arity}_{name}/1."
        )
        given_predicate, held_predicate = f"_given_{arity}_{name}", f"_held_{arity}_{name}"
        yield from (f"{given_predicate}({fact})." for fact in own)
        yield from (f"{held_predicate}({Function(name, row)})." for row in held_rows)
        ways = prod(map(len, values))
        valued = (
            name in self.problem.domain.quantities and own
        )  # then another value takes the place of the one that it has
        if ways <= MAX_CHOICES and not valued:
            self.count += ways
            body = [
                *(f"{domain}({place}, {term})" for place, term in enumerate(variables)),
                f"not {held_predicate}({atom})",
            ]
            yield f"{{ _assumed(add({atom})) }} :- {', '.join(body)}."
        yield f"{{ _assumed(remove({atom})) }} :- {given_predicate}({atom})."
        for place in range(arity if self.opened.replaced else 0):
            self.count += len(own) * len(values[place])
            new = Function(name, (*variables[:place], other_value, *variables[place + 1 :]))
            body = [
                f"{given_predicate}({atom})",
                f"{domain}({place}, {other_value})",
                f"not {held_predicate}({new})",
            ]
            yield f"{{ _assumed(change({atom}, {new})) }} :- {', '.join(body)}."
        target = str(Function(f"{prefix}{name}", variables))
        yield f"{target} :- _assumed(add({atom})). {target} :- _assumed(change(_, {atom}))."
        if prefix:
            yield (
                f"{LOOSENED_PREDICATE} :- _assumed(remove({atom})). {LOOSENED_PREDICATE} :- "
                f"_assumed(change({atom}, _))."
            )

    def _objects(self) -> Iterator[str]:
        """The choices among objects: a new one of a type, one less, one of another type."""
        types = [
            name
            for name, type_ in self.problem.domain.types.items()
            if not type_.constants and type_.parent != "term" and name in self.space.used
        ]
        yield "_lost(X) :- _lost_from(X, _). #defined _lost_from/2."
        for type_ in types:
            for name in (new_name(self.space, type_), *self.space.dangling):
                new = Function(type_, (Function(name),))
                yield f"{{ _assumed(add({new})) }}. {new} :- _assumed(add({new}))."
        for name, type_ in object_types(self.space).items():
            if type_ not in types:
                yield f"{type_}({name})."
                continue
            fact = Function(type_, (Function(name),))
            yield f"{fact} :- not _gone({fact}). {{ _assumed(remove({fact})) }}."
            yield f"_lost_from({name}, {type_}) :- _assumed(remove({fact}))."
            for other_type in types:
                if other_type != type_:
                    self.count += 1
                    moved = Function(other_type, fact.arguments)
                    yield (
                        f"{{ _assumed(change({fact}, {moved})) }}. {moved} :- "
                        f"_assumed(change({fact}, {moved}))."
                    )

    def _differences(self) -> Iterator[str]:
        """What edits change for the planner.

        Those that only take operators away, or change nothing, are no use.
        """
        yield (
            "_gain :- _new(_). _gain :- _other(_). :- not _gain. #defined _new/1. #defined "
            "_other/1."
        )
        yield (
            "_shown(new(A)) :- _new(A). _shown(lost(A)) :- _less(A). _shown(other(A)) :- _other(A)."
        )
        for name, arity in self.space.instances:
            yield from self._difference((name, arity), "_new", "_less")
        for signature in self.space.shared:
            yield from self._difference(signature, "_other", "_other")

    def _difference(self, signature: Signature, more: str, less: str) -> Iterator[str]:
        name, arity = signature
        variables = tuple(Variable(f"X{place}") for place in range(arity))
        now, before = Function(name, variables), Function(f"_before_{name}", variables)
        yield f"#defined {before.name}/{arity}. #defined {name}/{arity}."
        yield from (f"{Function(before.name, row)}." for row in self.space.rows(signature))
        yield f"{more}({now}) :- {now}, not {before}. {less}(no({now})) :- {before}, not {now}."


def object_types(space: ProblemSpace) -> dict[str, str]:
    """Every object with its type."""
    return {**space.problem.domain.objects, **space.problem.objects}


def new_name(space: ProblemSpace, type_: str) -> str:
    """A name for a new object of a type."""
    taken = {
        str(subterm)
        for rows in space.atoms.values()
        for row in rows
        for term in row
        for subterm in terms_within(term)
    }
    number = 1
    while f"{type_}_{number}" in taken:
        number += 1
    return f"{type_}_{number}"


def _edited_facts(edit: Edit) -> Iterator[Atom]:
    return (fact for fact in (edit.added, edit.removed) if fact is not None)


def _signature_of(atom: Atom) -> Signature:
    return atom.name, len(atom.arguments)
