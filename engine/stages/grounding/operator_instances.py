"""Ground operators made from rows of numbers: conditions, changes, resources, duration and cost."""

import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from cellwright.engine.kernels.bits import Bits, bitset
from cellwright.engine.model.ground_task import ConditionalEffect, GroundOperator
from cellwright.engine.stages.grounding.atom_deduction import Deduction
from cellwright.engine.stages.grounding.derived_atoms import Support, Supports
from cellwright.engine.stages.grounding.grounding_program import (
    Schema,
    is_conditional,
    signed_numbers,
)
from cellwright.engine.stages.grounding.numbered_atoms import Numbering, Universe
from cellwright.engine.stages.grounding.workflow_stages import (
    Advance,
    EventBatches,
    StageTurns,
    Workflow,
)
from cellwright.kb.asp.integer_tables import IntegerTable
from cellwright.kb.model.domain_model import Operator
from cellwright.kb.model.operator_amounts import Amounts, NoAmount, operator_traits
from cellwright.kb.terms import Atom, Function, Term, substitute_atom, term_variables


@dataclass(frozen=True, slots=True)
class InvalidAmount:
    """An instance of an operator whose duration or cost is no amount: `code`, what is wrong,
    and what to try.
    """

    operator: Operator
    code: str
    message: str
    hint: str


Traits = tuple[tuple[Term, ...], int, int]  # resources, duration, cost


class InstanceTraits:
    """The resources, the duration and the cost of an operator's instances.

    They are computed once for each combination of the arguments that they depend on.
    """

    def __init__(
        self, operator: Operator, amounts: Amounts, amiss: dict[tuple[str, str], InvalidAmount]
    ) -> None:
        self.operator, self.amounts, self.amiss = operator, amounts, amiss
        terms = [*operator.resources, *operator.amounts]
        named = {variable for term in terms for variable in term_variables(term)}
        alone = any(measured.name == operator.name for measured in amounts.measured)
        self.places = [
            place for place, variable in enumerate(operator.variables) if alone or variable in named
        ]
        self.known: dict[tuple[int, ...], Traits | None] = {}

    def of(self, row: list[int], instance: Function) -> Traits | None:
        """The traits of the instance in `row`; None if a resource has no value, so that there
        is no such instance.
        """
        key = tuple([row[place] for place in self.places])
        if key not in self.known:
            self.known[key] = self._evaluated(instance)
        return self.known[key]

    def _evaluated(self, instance: Function) -> Traits | None:
        try:
            instance_traits = operator_traits(self.operator, instance, self.amounts)
        except NoAmount as error:
            message = f"{error}, so nobody can tell how long {instance} takes or what it costs"
            self._note("K115", message, error.hint)
            return None
        if instance_traits is None:
            return None
        for name, value in (("duration", instance_traits.duration), ("cost", instance_traits.cost)):
            if value < 0:
                hint = f"a {name} must be 0 or more: exclude such instances in `where:`"
                self._note("K113", f"the {name} of {instance} is {value}", hint, name)
        return instance_traits.resources, instance_traits.duration, instance_traits.cost

    def _note(self, code: str, message: str, hint: str, name: str = "") -> None:
        """Note what is wrong, unless the operator has another instance with the same fault."""
        key = (self.operator.name, code + name)
        self.amiss.setdefault(key, InvalidAmount(self.operator, code, message, hint))


@dataclass(frozen=True, slots=True)
class ContradictingInstance:
    """An operator instance whose consequences both add and deny `atoms`."""

    operator: Operator
    instance: Function
    atoms: Bits
    adds: Bits


@dataclass(frozen=True, slots=True)
class DoubtfulDenial:
    """An operator instance that denies `atoms`, which have consequences if they were true before.

    Its `preconditions` do not contain these atoms. They may still exclude them.
    """

    instance: Function
    atoms: Bits
    preconditions: Bits


@dataclass(frozen=True, slots=True)
class InstanceRows:
    """The reachable instances of a schema, one per row.

    The columns are: arguments, one number per dynamic literal, added atoms, deleted atoms. The
    number -1 stands for an unreachable atom; it occurs only where the atom is negated or deleted.
    """

    schema: Schema
    table: IntegerTable
    adds: int

    @property
    def ends(self) -> tuple[int, int, int]:
        """The columns at which the arguments, the literals and the added atoms end (exclusive)."""
        arguments = len(self.schema.operator.parameters)
        literals = arguments + len(self.schema.literals)
        return arguments, literals, literals + self.adds

    def __iter__(self) -> Iterator[list[int]]:
        return iter(self.table)


@dataclass(frozen=True, slots=True)
class InstanceChanges:
    """What an instance adds and deletes, with everything that follows from it.

    `doubtful` are the denied atoms that have consequences and that the preconditions do not
    contain.
    """

    adds: Bits
    deletes: Bits
    doubtful: Bits = 0


@dataclass
class Instances:
    """Everything that is needed to turn rows into operators.

    `contradictions`, `doubts` and `amiss` collect what was found wrong on the way; `contradictions`
    has the operator's name as key, `amiss` also what is wrong.
    """

    universe: Universe
    deduction: Deduction
    supports: Supports
    workflow: Workflow
    batches: EventBatches
    turns: StageTurns
    numbering: Numbering
    effects: Mapping[tuple[str, tuple[int, ...]], list[tuple[tuple[int, ...], Bits, Bits]]]
    amounts: Amounts
    contradictions: dict[str, ContradictingInstance] = field(default_factory=dict)
    doubts: list[DoubtfulDenial] = field(default_factory=list)
    amiss: dict[tuple[str, str], InvalidAmount] = field(default_factory=dict)
    _sets: dict[tuple[int, ...], Bits] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.triggers = self.deduction.triggers()
        self.deduces = self.deduction.has_rules()

    def operators(self, schemas: Iterable[InstanceRows]) -> Iterator[GroundOperator]:
        """The ground operators of all rows: one for each support and choice of stages, each
        once.
        """
        for _, group in itertools.groupby(schemas, key=lambda rows: rows.schema.operator.name):
            parts = list(group)
            if len(parts) == 1 and self._is_plain(parts[0].schema):
                yield from self._plain(parts[0])
            else:
                yield from dict.fromkeys(
                    operator for rows in parts for operator in self._various(rows)
                )

    def _is_plain(self, schema: Schema) -> bool:
        """Whether each row is exactly one operator.

        This is so if all conditions are positive and on fluents, no effect is conditional and no
        stage can be chosen.
        """
        fluents = all(
            literal.positive and not self.universe.is_derived(literal.atom)
            for literal in schema.literals
        )
        effects = schema.operator.effects
        staged = any(effect.atom.name in self.workflow.events for effect in effects)
        staged = staged or self.turns.concerns(schema.operator)
        return fluents and not staged and not any(map(is_conditional, effects))

    def _plain(self, rows: InstanceRows) -> Iterator[GroundOperator]:
        name, terms = rows.schema.operator.name, self.universe.terms
        closing = _Closing(self, rows)
        shares = InstanceTraits(rows.schema.operator, self.amounts, self.amiss)
        arguments, literals, _ = rows.ends
        for row in rows:
            instance = Function(name, tuple([terms[number] for number in row[:arguments]]))
            base = self.bits(tuple(row[arguments:literals]))
            if (shared := shares.of(row, instance)) is None:
                continue
            changes = closing.changes(row, base, instance)
            yield GroundOperator(instance, base, changes.adds, changes.deletes, (), *shared)

    def _various(self, rows: InstanceRows) -> Iterator[GroundOperator]:
        operator, terms = rows.schema.operator, self.universe.terms
        closing = _Closing(self, rows)
        shares = InstanceTraits(operator, self.amounts, self.amiss)
        arguments, literals, _ = rows.ends
        for row in rows:
            instance = Function(operator.name, tuple([terms[number] for number in row[:arguments]]))
            own = tuple(row[:arguments])
            conditions = signed_numbers(rows.schema.literals, row[arguments:literals])
            conditions = (*conditions, *self.batches.conditions(operator.name, own))
            conditions = (*conditions, *self.turns.conditions(operator.name, own))
            if (shared := shares.of(row, instance)) is None:
                continue
            supports = self.supports.combinations(conditions)
            effects = tuple(self._conditional(operator, instance, own, conditions))
            events = self._events(operator, instance)
            for support, advance in itertools.product(supports, self.workflow.advances(events)):
                base = self.numbering.bits(support)
                added = closing.changes(row, base, instance).adds
                for needs in self._in_turn(support, base, added, advance):
                    changes = closing.changes(row, needs, instance)
                    adds, deletes = changes.adds | advance.adds, changes.deletes | advance.deletes
                    yield GroundOperator(
                        instance, needs | advance.conditions, adds, deletes, effects, *shared
                    )

    def _in_turn(
        self, support: Support, base: Bits, added: Bits, advance: Advance
    ) -> Iterator[Bits]:
        """The preconditions under which an instance may add some atoms: none of them before its
        turn.
        """
        if not added & self.turns.held:
            yield base
            return
        for turn_conditions in self.turns.ways(added, advance):
            for more in self.supports.combinations((*support, *turn_conditions)):
                yield self.numbering.bits(more)

    def _events(self, operator: Operator, instance: Function) -> list[Atom]:
        changes = (effect for effect in operator.effects if not is_conditional(effect))
        events = [change.atom for change in changes if change.atom.name in self.workflow.events]
        bindings = dict(zip(operator.variables, instance.arguments, strict=True)) if events else {}
        return [substitute_atom(event, bindings) for event in events]

    def bits(self, atoms: tuple[int, ...]) -> Bits:
        """The bitset of a few atoms. A single atom always gives the same object."""
        if len(atoms) > 1:
            return bitset(atoms)
        mask = self._sets.get(atoms)
        if mask is None:
            mask = self._sets[atoms] = bitset(atoms)
        return mask

    def contradicts(self, operator: Operator, instance: Function, atoms: Bits, adds: Bits) -> None:
        """Notes a contradiction, unless the operator has one already."""
        self.contradictions.setdefault(
            operator.name, ContradictingInstance(operator, instance, atoms, adds)
        )

    def _conditional(
        self,
        operator: Operator,
        instance: Function,
        arguments: tuple[int, ...],
        required: Sequence[int],
    ) -> Iterator[ConditionalEffect]:
        if not any(map(is_conditional, operator.effects)):
            return
        for conditions, adds, deletes in self.effects.get((operator.name, arguments), ()):
            for support in self.supports.combinations(conditions):
                before = self.numbering.bits(
                    atom for atom in (*support, *required) if self._is_fluent(atom)
                )
                added, denied = self.deduction.close(adds, before)
                if added & denied:
                    self.contradicts(operator, instance, added & denied, adds)
                # makes complements, for regression
                self.numbering.bits([~atom for atom in support])
                yield ConditionalEffect(
                    self.numbering.bits(support), added, (denied | deletes) & ~added
                )

        for conditions, advance in self.batches.advances(operator.name, arguments):
            for support in self.supports.combinations(conditions):
                bits = self.numbering.bits(support)
                yield ConditionalEffect(bits, advance.adds, advance.deletes)

    def _is_fluent(self, number: int) -> bool:
        return 0 <= number < len(self.universe.atoms)


class _Closing:
    """The changes of the instances of a schema. Equal changes are computed once."""

    def __init__(self, instances: Instances, rows: InstanceRows) -> None:
        self.made, self.operator = instances, rows.schema.operator
        _, self.literals, self.adds = rows.ends
        self.known: dict[tuple[tuple[int, ...], Bits], InstanceChanges] = {}

    def changes(self, row: list[int], base: Bits, instance: Function) -> InstanceChanges:
        """What the instance in `row` adds and deletes when its preconditions are `base`."""
        instances = self.made
        before = base & instances.triggers
        key = (tuple(row[self.literals :]), before)
        changes = self.known.get(key)
        if changes is None:
            changes = self.known[key] = self._closed(row, before, instance)
        if changes.doubtful:
            instances.doubts.append(DoubtfulDenial(instance, changes.doubtful, base))
        return changes

    def _closed(self, row: list[int], before: Bits, instance: Function) -> InstanceChanges:
        instances = self.made
        adds = instances.bits(tuple(row[self.literals : self.adds]))
        deletes = instances.bits(tuple([atom for atom in row[self.adds :] if atom >= 0]))
        if deletes & adds:  # an atom that is both deleted and added stays true
            deletes &= ~adds
        if not instances.deduces:
            return InstanceChanges(adds, deletes)
        added, denied = instances.deduction.close(adds, before, deletes)
        if added & denied:
            instances.contradicts(self.operator, instance, added & denied, adds)
        ends = denied | deletes
        return InstanceChanges(added, ends & ~added, ends & instances.triggers & ~before)
