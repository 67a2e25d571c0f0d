"""Grounding turns a problem into a ground task. clingo finds what can be reached and returns it as
numbers; Python makes bitsets of them.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TypeVar

from cellwright.engine.kernels.bits import Bits, bitset
from cellwright.engine.model.ground_task import GroundOperator, GroundTask
from cellwright.engine.stages.grounding.atom_deduction import build_deduction
from cellwright.engine.stages.grounding.derived_atoms import (
    Rules,
    Support,
    Supports,
    layer_axioms,
    supports_of,
)
from cellwright.engine.stages.grounding.fluent_aggregates import (
    decide_aggregates,
    expand_aggregates,
)
from cellwright.engine.stages.grounding.ground_diagnostics import (
    find_ambiguities,
    report_contradictions,
    report_invalid_amounts,
    violated_constraints,
)
from cellwright.engine.stages.grounding.ground_goals import (
    GoalAlternatives,
    TaskWithoutGoals,
    criticality_weights,
    derive_alternative_goals,
)
from cellwright.engine.stages.grounding.grounding_program import (
    ChangingPredicates,
    conditional_alternatives,
    instance_text,
    is_conditional,
    precondition_schemas,
    rule_text,
)
from cellwright.engine.stages.grounding.initial_facts import default_instances as default_instances
from cellwright.engine.stages.grounding.initial_facts import initial_state
from cellwright.engine.stages.grounding.instance_bounds import size_suspects
from cellwright.engine.stages.grounding.mutex_invariants import (
    drop_impossible_effects,
    mutex_groups,
)
from cellwright.engine.stages.grounding.numbered_atoms import (
    FIRST_DERIVED_NUMBER,
    Numbering,
    Universe,
    complement_effects,
)
from cellwright.engine.stages.grounding.numeric_quantities import (
    COMPARISON_PREFIX,
    TaskQuantities,
    unsatisfiable_tests,
    with_tests,
    without_quantities,
)
from cellwright.engine.stages.grounding.operator_instances import DoubtfulDenial, Instances
from cellwright.engine.stages.grounding.reachable_instances import (
    ReachabilityProgram,
    conditional_changes,
    happening_terms,
    read_derivations,
    read_happenings,
    read_instances,
    read_matches,
)
from cellwright.engine.stages.grounding.workflow_stages import EventBatches, StageTurns, Workflow
from cellwright.kb.asp import Grounder
from cellwright.kb.asp.overflow import overflows, rules_that_watch
from cellwright.kb.asp.static_facts import try_first, within_limits
from cellwright.kb.diagnostics import Diagnostic, InvalidInput
from cellwright.kb.garbage_collection import no_search_for_cycles
from cellwright.kb.loader.problem_amounts import amounts_of
from cellwright.kb.model.condition_forms import Normaliser
from cellwright.kb.model.conditions import Literal, goal_parts
from cellwright.kb.model.domain_model import Kind, Rule
from cellwright.kb.model.planning_problem import Listed, Problem, late_stages, stage_holds
from cellwright.kb.terms import Atom, Function

Made = TypeVar("Made", GroundTask, TaskWithoutGoals)


def ground(problem: Problem) -> GroundTask:
    """The ground task of a problem.

    Raises `InvalidInput` with everything that is found wrong: violated constraints, contradictions
    and ambiguities among deductive operators, and a grounding that exceeds its limits.
    """
    return _run_grounding(problem, _Grounding.task)


def ground_parts(problem: Problem) -> TaskWithoutGoals:
    """The ground task of a problem whose goals are `separable`, to be asked for each conjunct and
    chain by itself.

    The other goals change which atoms have a number, but not what can be reached: the steps that
    move other chains are left out. Raises as `ground` does.
    """
    return _run_grounding(problem, _Grounding.parts)


def has_separable_chains(problem: Problem) -> bool:
    """Whether each chain can be left out by leaving out the steps that move it.

    That is not so where chains wait for others, where no step may reach a stage before its turn,
    and where a step does something to whatever is there: then a chain that is not wanted changes
    what steps need.
    """
    events = {
        name
        for name, predicate in problem.domain.predicates.items()
        if predicate.kind is Kind.EVENT
    }
    batches = any(
        is_conditional(effect) and effect.atom.name in events
        for operator in problem.domain.operators
        for effect in operator.effects
    )
    waiting = any(chain.after for chain in problem.chains)
    return not (batches or waiting or late_stages(problem.chains, problem.domain))


def _run_grounding(problem: Problem, result_of: Callable[["_Grounding"], Made]) -> Made:
    with no_search_for_cycles():
        grounding = _Grounding(problem)
        with within_limits(lambda: size_suspects(problem, grounding.schemas)):
            result = result_of(grounding)
    if grounding.found:
        raise InvalidInput(grounding.found)
    return result


def reachable_operators(task: GroundTask) -> frozenset[str]:
    """The names of the operators that have at least one instance in the task."""
    return frozenset(operator.instance.name for operator in task.operators)


def reachable_atoms(task: GroundTask) -> frozenset[Atom]:
    """The atoms that are true at the start or that some operator can add."""
    added = task.initial
    for operator in task.operators:
        added |= operator.adds
        for effect in operator.conditional:
            added |= effect.adds
    return frozenset(task.names(added))


@dataclass(frozen=True, slots=True)
class _Compiled:
    """Operators, start and goals over numbered `atoms`.

    Derived atoms and complements are not among them yet.
    """

    atoms: list[Atom]
    operators: list[GroundOperator]
    start: Bits
    goals: list[Bits]
    doubts: list[DoubtfulDenial]


class _Grounding:
    """The steps of one grounding; each step uses the results of the steps before it.

    `found` lists what is wrong.
    """

    def __init__(self, problem: Problem) -> None:
        self.given, self.taken = problem, without_quantities(problem)
        self.problem, self.domain = self.taken.problem, self.taken.problem.domain
        self.found: list[Diagnostic] = []
        normaliser = Normaliser()
        compared = [Rule(test.head, ()) for test in self.taken.tests]
        vocabulary = ChangingPredicates(self.domain, compared)
        self.schemas = list(precondition_schemas(self.domain, normaliser, vocabulary))
        conditional_effects = list(conditional_alternatives(self.domain, normaliser, vocabulary))
        self.batches = [
            conditional
            for conditional in conditional_effects
            if conditional.effect.atom.name in vocabulary.events
        ]
        self.conditionals = [
            conditional for conditional in conditional_effects if conditional not in self.batches
        ]
        self.goals = [normaliser.disjuncts(part, {}) for part in goal_parts(self.problem.goal)]
        plain = expand_aggregates(
            self.domain.rules, self.domain, ChangingPredicates(self.domain).is_dynamic
        )
        self.reach, self.fittings = plain.reach, plain.fittings
        self.rules = [*plain.rules, *normaliser.rules]
        invented = [*normaliser.rules, *plain.rules, *plain.reach, *compared]
        self.vocabulary = ChangingPredicates(self.domain, invented)
        declared = self.domain.predicates
        self.invented = {
            r.head.name: len(r.head.arguments) for r in invented if r.head.name not in declared
        }

    def task(self) -> GroundTask:
        """The task. It is meaningless if `found` is not empty."""
        return self._grounded(apart=False).task

    def parts(self) -> TaskWithoutGoals:
        """The task without goals, and the ways to satisfy each of them.

        It is meaningless if `found` is not empty.
        """
        return self._grounded(apart=True)

    def _grounded(self, apart: bool) -> TaskWithoutGoals:
        initial, contradicted = initial_state(self.problem, self.vocabulary)
        self.found += contradicted
        universe = self._reachable(initial)
        rules = read_derivations(self.rules, self.vocabulary, universe)
        effects = build_deduction(self.domain, self.vocabulary, universe)
        decide_aggregates(self.fittings, universe, effects.denied, rules)
        workflow = Workflow(
            self.problem,
            universe,
            len(universe.atoms),
            self.vocabulary.events,
            stage_holds(Listed(initial)),
        )
        batches = EventBatches(
            workflow, read_happenings(self.batches, self.schemas, universe), universe, rules
        )
        changes = conditional_changes(self.conditionals, self.schemas, universe)
        start = bitset([universe.index[atom] for atom in initial])
        turns = StageTurns(self.domain, workflow, universe, start, effects, changes, rules)
        supports = self._supports(universe, rules)
        ways = self._ways(universe, supports, rules)
        goals = GoalAlternatives([] if apart else ways, len(universe.atoms) + len(workflow.atoms))
        numbering = Numbering(len(universe.atoms) + len(workflow.atoms) + len(goals.atoms))
        amounts = amounts_of(self.problem, universe.facts)
        ground_instances = Instances(
            universe, effects, supports, workflow, batches, turns, numbering, changes, amounts
        )
        operators = [
            *ground_instances.operators(read_instances(self.schemas, self.vocabulary, universe)),
            *workflow.reaching,
        ]
        self.found += [
            *report_contradictions(ground_instances, universe),
            *report_invalid_amounts(ground_instances),
        ]
        start |= workflow.initial | goals.initial
        alternatives, completed = goals.compiled(operators, numbering)
        single = tuple(tuple(map(numbering.bits, part)) for part in ways) if apart else ()
        task = self._with_axioms(
            _Compiled(
                [*universe.atoms, *workflow.atoms, *goals.atoms],
                completed,
                start,
                [goal | workflow.goal for goal in alternatives],
                []
                if contradicted
                else ground_instances.doubts,  # then two atoms of a mutex group may be true
            ),
            universe,
            rules,
            numbering,
        )
        return TaskWithoutGoals(task, single, dict(workflow.counted(universe)) if apart else {})

    def _with_axioms(
        self, compiled: "_Compiled", universe: Universe, rules: Rules, numbering: Numbering
    ) -> GroundTask:
        """The task with axioms for derived atoms, complements of atoms, and quantities."""
        layers = layer_axioms(rules, numbering, lambda atom: self._compares(universe, atom))
        complements = bitset(
            [c for a, c in numbering.complements.items() if not compiled.start >> a & 1]
        )
        atoms = [*compiled.atoms, *(_signed_atom(signed, universe) for signed in numbering.added)]
        numbers = TaskQuantities(self.taken, self.given.domain, atoms)
        tests = tuple(numbers.comparing(universe, numbering))
        layers = with_tests(layers, tests, numbering, len(atoms))
        never, complete = (
            unsatisfiable_tests(tests, numbering),
            (complement_effects(o, numbering) for o in compiled.operators),
        )
        operators = [
            numbers.changing(operator)
            for operator in complete
            if not operator.preconditions & never
        ]
        derived = layers.derived if layers else 0
        groups = mutex_groups(atoms, operators, compiled.start | complements, derived)
        pairs = [1 << atom | 1 << complement for atom, complement in numbering.complements.items()]
        operators = list(drop_impossible_effects(operators, (*groups, *pairs)))
        self.found += find_ambiguities(self.domain, compiled.doubts, atoms, groups)
        weighed = criticality_weights(self.domain, atoms, operators)
        start = compiled.start | numbers.start | complements
        return GroundTask(
            atoms if self.given.domain.quantities else tuple(atoms),
            tuple(operators),
            layers.closed(start) if layers else start,
            tuple(compiled.goals),
            weighed,
            tuple(dict.fromkeys((*groups, *pairs))),
            axioms=layers,
        )

    def _supports(self, universe: Universe, rules: Rules) -> Supports:
        """The supports of derived atoms.

        Those that compare quantities have none: they stay in the task, as axioms.
        """
        numbers = range(FIRST_DERIVED_NUMBER, FIRST_DERIVED_NUMBER + len(universe.derived))
        listed = [number for number in numbers if not self._compares(universe, number)]
        return supports_of(listed, rules, self._negated(universe))

    def _compares(self, universe: Universe, atom: int) -> bool:
        """Whether a derived atom compares quantities."""
        return bool(self.taken.tests) and universe.atom(atom).name.startswith(COMPARISON_PREFIX)

    def _negated(self, universe: Universe) -> Iterator[int]:
        """The derived atoms that conditions need to be false."""
        bodies = [
            *(schema.literals for schema in self.schemas),
            *(conditional.literals for conditional in self.conditionals),
            *(rule_.body for rule_ in self.rules),
            *(disjunct for part in self.goals for disjunct in part),
        ]
        names = {
            p.atom.name
            for body in bodies
            for p in body
            if isinstance(p, Literal) and not p.positive
        }
        return (
            FIRST_DERIVED_NUMBER + number
            for number, atom in enumerate(universe.derived)
            if atom.name in names
        )

    def _ways(self, universe: Universe, supports: Supports, rules: Rules) -> list[list[Support]]:
        """The ways to satisfy each conjunct of the goal."""
        named = {
            f"_goal_{part}_{number}": self.vocabulary.split(disjunct)
            for part, disjuncts in enumerate(self.goals)
            for number, disjunct in enumerate(disjuncts)
        }
        ways_by_name = read_matches(named, universe)
        parts = [
            [
                support
                for number, _ in enumerate(disjuncts)
                for support in ways_by_name[f"_goal_{part}_{number}"]
            ]
            for part, disjuncts in enumerate(self.goals)
        ]
        if supports.stay:
            return derive_alternative_goals(
                [[frozenset(support) for support in part] for part in parts], universe, rules
            )
        return [
            list(dict.fromkeys(s for support in part for s in supports.combinations(support)))
            for part in parts
        ]

    def _reachable(self, initial: tuple[Atom, ...]) -> Universe:
        program = ReachabilityProgram(
            self.taken,
            self.vocabulary,
            self.schemas,
            self.conditionals,
            (*self.rules, *self.reach),
            self.goals,
        )
        watched = list(program.watched_rules())
        grounder, text = Grounder(), "\n".join([*program.text(initial), rules_that_watch(watched)])
        try_first(size_suspects(self.problem, self.schemas), text)
        grounder.ground(text)
        self.found += [*violated_constraints(self.problem, grounder), *overflows(watched, grounder)]
        universe = Universe(grounder, self.vocabulary, self.invented)
        arguments = [
            rule_text(f"_arg({v})", [instance_text(s)])
            for s in self.schemas
            for v in s.operator.variables
        ]
        pairs = (
            (batch, s)
            for batch in self.batches
            for s in self.schemas
            if batch.operator is s.operator
        )
        universe.name_terms(
            [*arguments, *(text for pair in pairs for text in happening_terms(*pair))]
        )
        return universe


def _signed_atom(signed: int, universe: Universe) -> Atom:
    """The name of a complementary or derived atom."""
    return universe.atom(signed) if signed >= 0 else Function("not", (universe.atom(~signed),))
