"""Grounding turns a problem into a ground task. clingo finds what can be reached and returns it as numbers;
Python makes bitsets of them.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TypeVar

from cellwright.engine.model.task import Bits, GroundOperator, Task, bitset
from cellwright.engine.stages.grounding.aggregates import expanded
from cellwright.engine.stages.grounding.ambiguity import ambiguities
from cellwright.engine.stages.grounding.batches import Batches
from cellwright.engine.stages.grounding.closure import deduction
from cellwright.engine.stages.grounding.derived import Rules, Support, Supports, supports_of
from cellwright.engine.stages.grounding.diagnostics import amiss, contradictions, violations
from cellwright.engine.stages.grounding.diagrams import decide
from cellwright.engine.stages.grounding.firing import firing
from cellwright.engine.stages.grounding.goals import Goals, Parted, layered
from cellwright.engine.stages.grounding.initial import default_instances as default_instances
from cellwright.engine.stages.grounding.initial import initial_state
from cellwright.engine.stages.grounding.instances import Doubt, Instances
from cellwright.engine.stages.grounding.invariants import mutex_groups
from cellwright.engine.stages.grounding.layers import axioms
from cellwright.engine.stages.grounding.levels import Numbers, unmeetable, with_tests
from cellwright.engine.stages.grounding.limits import suspects
from cellwright.engine.stages.grounding.numbering import DERIVED, Numbering, complemented
from cellwright.engine.stages.grounding.numeric import COMPARED, without_quantities
from cellwright.engine.stages.grounding.program import (
    Vocabulary,
    conditionals,
    instance,
    is_conditional,
    rule,
    schemas,
)
from cellwright.engine.stages.grounding.reachability import Reachability
from cellwright.engine.stages.grounding.rows import (
    conditional_changes,
    derivations,
    happening_terms,
    happenings,
    instances,
    matches,
)
from cellwright.engine.stages.grounding.turns import Turns
from cellwright.engine.stages.grounding.universe import Universe
from cellwright.engine.stages.grounding.weights import weights
from cellwright.engine.stages.grounding.workflow import Workflow
from cellwright.kb.asp import Grounder
from cellwright.kb.asp.statics import try_first, within_limits
from cellwright.kb.cycles import no_search_for_cycles
from cellwright.kb.diagnostics import Diagnostic, InvalidInput
from cellwright.kb.loader.amounts import amounts_of
from cellwright.kb.model.conditions import Literal, goal_parts
from cellwright.kb.model.domain import Kind, Rule
from cellwright.kb.model.normalise import Normaliser
from cellwright.kb.model.problem import Problem
from cellwright.kb.model.workflow import Listed, holding, late_stages
from cellwright.kb.terms import Atom, Function

Made = TypeVar("Made", Task, Parted)


def ground(problem: Problem) -> Task:
    """The ground task of a problem.

    Raises `InvalidInput` with everything that is found wrong: violated constraints, contradictions and
    ambiguities among deductive operators, and a grounding that exceeds its limits.
    """
    return _grounded(problem, _Grounding.task)


def ground_parts(problem: Problem) -> Parted:
    """The ground task of a problem whose goals are `separable`, to be asked for each conjunct and chain by itself.

    The other goals change which atoms have a number, but not what can be reached: the steps that move other chains are left
    out. Raises as `ground` does.
    """
    return _grounded(problem, _Grounding.parts)


def separable(problem: Problem) -> bool:
    """Whether each chain can be left out by leaving out the steps that move it.

    That is not so where chains wait for others, where no step may reach a stage before its turn, and where a step does
    something to whatever is there: then a chain that is not wanted changes what steps need.
    """
    events = {name for name, each in problem.domain.predicates.items() if each.kind is Kind.EVENT}
    batches = any(
        is_conditional(effect) and effect.atom.name in events
        for operator in problem.domain.operators
        for effect in operator.effects
    )
    waiting = any(chain.after for chain in problem.chains)
    return not (batches or waiting or late_stages(problem.chains, problem.domain))


def _grounded(problem: Problem, made: Callable[["_Grounding"], Made]) -> Made:
    with no_search_for_cycles():
        grounding = _Grounding(problem)
        with within_limits(lambda: suspects(problem, grounding.schemas)):
            found = made(grounding)
    if grounding.found:
        raise InvalidInput(grounding.found)
    return found


def reachable_operators(task: Task) -> frozenset[str]:
    """The names of the operators that have at least one instance in the task."""
    return frozenset(operator.instance.name for operator in task.operators)


def reachable_atoms(task: Task) -> frozenset[Atom]:
    """The atoms that are true at the start or that some operator can add."""
    added = task.initial
    for operator in task.operators:
        added |= operator.adds
        for effect in operator.conditional:
            added |= effect.adds
    return frozenset(task.names(added))


@dataclass(frozen=True, slots=True)
class _Compiled:
    """Operators, start and goals over numbered `atoms`. Derived atoms and complements are not among them yet."""

    atoms: list[Atom]
    operators: list[GroundOperator]
    start: Bits
    goals: list[Bits]
    doubts: list[Doubt]


class _Grounding:
    """The steps of one grounding; each step uses the results of the steps before it.

    `found` lists what is wrong.
    """

    def __init__(self, problem: Problem) -> None:
        self.given, self.taken = problem, without_quantities(problem)
        self.problem, self.domain = self.taken.problem, self.taken.problem.domain
        self.found: list[Diagnostic] = []
        normaliser = Normaliser()
        compared = [Rule(each.head, ()) for each in self.taken.tests]
        vocabulary = Vocabulary(self.domain, compared)
        self.schemas = list(schemas(self.domain, normaliser, vocabulary))
        found = list(conditionals(self.domain, normaliser, vocabulary))
        self.batches = [each for each in found if each.effect.atom.name in vocabulary.events]
        self.conditionals = [each for each in found if each not in self.batches]
        self.goals = [normaliser.disjuncts(part, {}) for part in goal_parts(self.problem.goal)]
        plain = expanded(self.domain.rules, self.domain, Vocabulary(self.domain).is_dynamic)
        self.reach, self.fittings = plain.reach, plain.fittings
        self.rules = [*plain.rules, *normaliser.rules]
        invented = [*normaliser.rules, *plain.rules, *plain.reach, *compared]
        self.vocabulary = Vocabulary(self.domain, invented)
        declared = self.domain.predicates
        self.invented = {r.head.name: len(r.head.arguments) for r in invented if r.head.name not in declared}

    def task(self) -> Task:
        """The task. It is meaningless if `found` is not empty."""
        return self._grounded(apart=False).task

    def parts(self) -> Parted:
        """The task without goals, and the ways to satisfy each of them. It is meaningless if `found` is not empty."""
        return self._grounded(apart=True)

    def _grounded(self, apart: bool) -> Parted:
        initial, contradicted = initial_state(self.problem, self.vocabulary)
        self.found += contradicted
        universe = self._reachable(initial)
        rules = derivations(self.rules, self.vocabulary, universe)
        effects = deduction(self.domain, self.vocabulary, universe)
        decide(self.fittings, universe, effects.denied, rules)
        workflow = Workflow(
            self.problem, universe, len(universe.atoms), self.vocabulary.events, holding(Listed(initial))
        )
        batches = Batches(workflow, happenings(self.batches, self.schemas, universe), universe, rules)
        changes = conditional_changes(self.conditionals, self.schemas, universe)
        start = bitset([universe.index[atom] for atom in initial])
        turns = Turns(self.domain, workflow, universe, start, effects, changes, rules)
        supports = self._supports(universe, rules)
        ways = self._ways(universe, supports, rules)
        goals = Goals([] if apart else ways, len(universe.atoms) + len(workflow.atoms))
        numbering = Numbering(len(universe.atoms) + len(workflow.atoms) + len(goals.atoms))
        amounts = amounts_of(self.problem, universe.facts)
        made = Instances(universe, effects, supports, workflow, batches, turns, numbering, changes, amounts)
        operators = [*made.operators(instances(self.schemas, self.vocabulary, universe)), *workflow.reaching]
        self.found += [*contradictions(made, universe), *amiss(made)]
        start |= workflow.initial | goals.initial
        alternatives, completed = goals.compiled(operators, numbering)
        single = tuple(tuple(map(numbering.bits, part)) for part in ways) if apart else ()
        task = self._with_axioms(
            _Compiled(
                [*universe.atoms, *workflow.atoms, *goals.atoms],
                completed,
                start,
                [goal | workflow.goal for goal in alternatives],
                [] if contradicted else made.doubts,  # then two atoms of a mutex group may be true
            ),
            universe,
            rules,
            numbering,
        )
        return Parted(task, single, dict(workflow.counted(universe)) if apart else {})

    def _with_axioms(
        self, compiled: "_Compiled", universe: Universe, rules: Rules, numbering: Numbering
    ) -> Task:
        """The task with axioms for derived atoms, complements of atoms, and quantities."""
        layers = axioms(rules, numbering, lambda atom: self._compares(universe, atom))
        complements = bitset([c for a, c in numbering.complements.items() if not compiled.start >> a & 1])
        atoms = [*compiled.atoms, *(_named(signed, universe) for signed in numbering.added)]
        numbers = Numbers(self.taken, self.given.domain, atoms)
        tests = tuple(numbers.comparing(universe, numbering))
        layers = with_tests(layers, tests, numbering, len(atoms))
        never, complete = (
            unmeetable(tests, numbering),
            (complemented(o, numbering) for o in compiled.operators),
        )
        operators = [numbers.changing(each) for each in complete if not each.preconditions & never]
        derived = layers.derived if layers else 0
        groups = mutex_groups(atoms, operators, compiled.start | complements, derived)
        pairs = [1 << atom | 1 << complement for atom, complement in numbering.complements.items()]
        operators = list(firing(operators, (*groups, *pairs)))
        self.found += ambiguities(self.domain, compiled.doubts, atoms, groups)
        weighed = weights(self.domain, atoms, operators)
        start = compiled.start | numbers.start | complements
        return Task(
            atoms if self.given.domain.quantities else tuple(atoms),
            tuple(operators),
            layers.closed(start) if layers else start,
            tuple(compiled.goals),
            weighed,
            tuple(dict.fromkeys((*groups, *pairs))),
            axioms=layers,
        )

    def _supports(self, universe: Universe, rules: Rules) -> Supports:
        """The supports of derived atoms. Those that compare quantities have none: they stay in the task, as axioms."""
        numbers = range(DERIVED, DERIVED + len(universe.derived))
        listed = [each for each in numbers if not self._compares(universe, each)]
        return supports_of(listed, rules, self._negated(universe))

    def _compares(self, universe: Universe, atom: int) -> bool:
        """Whether a derived atom compares quantities."""
        return bool(self.taken.tests) and universe.atom(atom).name.startswith(COMPARED)

    def _negated(self, universe: Universe) -> Iterator[int]:
        """The derived atoms that conditions need to be false."""
        bodies = [
            *(schema.literals for schema in self.schemas),
            *(each.literals for each in self.conditionals),
            *(rule_.body for rule_ in self.rules),
            *(disjunct for part in self.goals for disjunct in part),
        ]
        names = {p.atom.name for body in bodies for p in body if isinstance(p, Literal) and not p.positive}
        return (DERIVED + number for number, atom in enumerate(universe.derived) if atom.name in names)

    def _ways(self, universe: Universe, supports: Supports, rules: Rules) -> list[list[Support]]:
        """The ways to satisfy each conjunct of the goal."""
        named = {
            f"_goal_{part}_{number}": self.vocabulary.split(disjunct)
            for part, disjuncts in enumerate(self.goals)
            for number, disjunct in enumerate(disjuncts)
        }
        found = matches(named, universe)
        parts = [
            [way for number, _ in enumerate(disjuncts) for way in found[f"_goal_{part}_{number}"]]
            for part, disjuncts in enumerate(self.goals)
        ]
        if supports.stay:
            return layered([[frozenset(way) for way in part] for part in parts], universe, rules)
        return [list(dict.fromkeys(s for way in part for s in supports.combinations(way))) for part in parts]

    def _reachable(self, initial: tuple[Atom, ...]) -> Universe:
        program = Reachability(
            self.taken,
            self.vocabulary,
            self.schemas,
            self.conditionals,
            (*self.rules, *self.reach),
            self.goals,
        )
        grounder, text = Grounder(), "\n".join(program.text(initial))
        try_first(suspects(self.problem, self.schemas), text)
        grounder.ground(text)
        self.found += violations(self.problem, grounder)
        universe = Universe(grounder, self.vocabulary, self.invented)
        arguments = [rule(f"_arg({v})", [instance(s)]) for s in self.schemas for v in s.operator.variables]
        pairs = ((each, s) for each in self.batches for s in self.schemas if each.operator is s.operator)
        universe.name_terms([*arguments, *(text for pair in pairs for text in happening_terms(*pair))])
        return universe


def _named(signed: int, universe: Universe) -> Atom:
    """The name of a complementary or derived atom."""
    return universe.atom(signed) if signed >= 0 else Function("not", (universe.atom(~signed),))
