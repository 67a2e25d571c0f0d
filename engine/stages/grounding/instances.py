"""Ground operators are made from rows of numbers: conditions, supports, deduced changes, workflow stages.

There may be a million rows. So values that the rows of a schema share are computed once, and equal bitsets
are one object.
"""

import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from cellwright.engine.model.task import Bits, ConditionalEffect, GroundOperator, bitset
from cellwright.engine.stages.grounding.batches import Batches
from cellwright.engine.stages.grounding.closure import Deduction
from cellwright.engine.stages.grounding.derived import Support, Supports
from cellwright.engine.stages.grounding.numbering import Numbering
from cellwright.engine.stages.grounding.program import Schema, is_conditional, signed
from cellwright.engine.stages.grounding.traits import Amiss, Shared
from cellwright.engine.stages.grounding.turns import Turns
from cellwright.engine.stages.grounding.universe import Universe
from cellwright.engine.stages.grounding.workflow import Advance, Workflow
from cellwright.kb.asp.tables import Table
from cellwright.kb.model.amounts import Amounts
from cellwright.kb.model.domain import Operator
from cellwright.kb.terms import Atom, Function, substitute_atom


@dataclass(frozen=True, slots=True)
class Contradiction:
    """An operator instance whose consequences both add and deny `atoms`."""

    operator: Operator
    instance: Function
    atoms: Bits
    adds: Bits


@dataclass(frozen=True, slots=True)
class Doubt:
    """An operator instance that denies `atoms`, which have consequences if they were true before.

    Its `preconditions` do not contain these atoms. They may still exclude them.
    """

    instance: Function
    atoms: Bits
    preconditions: Bits


@dataclass(frozen=True, slots=True)
class InstanceRows:
    """The reachable instances of a schema, one per row.

    The columns are: arguments, one number per dynamic literal, added atoms, deleted atoms. The number -1
    stands for an unreachable atom; it occurs only where the atom is negated or deleted.
    """

    schema: Schema
    table: Table
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
class Changes:
    """What an instance adds and deletes, with everything that follows from it.

    `doubtful` are the denied atoms that have consequences and that the preconditions do not contain.
    """

    adds: Bits
    deletes: Bits
    doubtful: Bits = 0


@dataclass
class Instances:
    """Everything that is needed to turn rows into operators.

    `contradictions`, `doubts` and `amiss` collect what was found wrong on the way; `contradictions` has the operator's
    name as key, `amiss` also what is wrong.
    """

    universe: Universe
    deduction: Deduction
    supports: Supports
    workflow: Workflow
    batches: Batches
    turns: Turns
    numbering: Numbering
    effects: Mapping[tuple[str, tuple[int, ...]], list[tuple[tuple[int, ...], Bits, Bits]]]
    amounts: Amounts
    contradictions: dict[str, Contradiction] = field(default_factory=dict)
    doubts: list[Doubt] = field(default_factory=list)
    amiss: dict[tuple[str, str], Amiss] = field(default_factory=dict)
    _sets: dict[tuple[int, ...], Bits] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.triggers = self.deduction.triggers()
        self.deduces = self.deduction.has_rules()

    def operators(self, schemas: Iterable[InstanceRows]) -> Iterator[GroundOperator]:
        """The ground operators of all rows: one for each support and choice of stages, each once."""
        for _, group in itertools.groupby(schemas, key=lambda rows: rows.schema.operator.name):
            parts = list(group)
            if len(parts) == 1 and self._is_plain(parts[0].schema):
                yield from self._plain(parts[0])
            else:
                yield from dict.fromkeys(made for rows in parts for made in self._various(rows))

    def _is_plain(self, schema: Schema) -> bool:
        """Whether each row is exactly one operator.

        This is so if all conditions are positive and on fluents, no effect is conditional and no stage can be
        chosen.
        """
        fluents = all(each.positive and not self.universe.is_derived(each.atom) for each in schema.literals)
        effects = schema.operator.effects
        staged = any(each.atom.name in self.workflow.events for each in effects)
        staged = staged or self.turns.concerns(schema.operator)
        return fluents and not staged and not any(map(is_conditional, effects))

    def _plain(self, rows: InstanceRows) -> Iterator[GroundOperator]:
        name, terms = rows.schema.operator.name, self.universe.terms
        closing = _Closing(self, rows)
        shares = Shared(rows.schema.operator, self.amounts, self.amiss)
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
        shares = Shared(operator, self.amounts, self.amiss)
        arguments, literals, _ = rows.ends
        for row in rows:
            instance = Function(operator.name, tuple([terms[number] for number in row[:arguments]]))
            own = tuple(row[:arguments])
            conditions = signed(rows.schema.literals, row[arguments:literals])
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

    def _in_turn(self, support: Support, base: Bits, added: Bits, advance: Advance) -> Iterator[Bits]:
        """The preconditions under which an instance may add some atoms: none of them before its turn."""
        if not added & self.turns.held:
            yield base
            return
        for way in self.turns.ways(added, advance):
            for more in self.supports.combinations((*support, *way)):
                yield self.numbering.bits(more)

    def _events(self, operator: Operator, instance: Function) -> list[Atom]:
        changes = (each for each in operator.effects if not is_conditional(each))
        events = [each.atom for each in changes if each.atom.name in self.workflow.events]
        bindings = dict(zip(operator.variables, instance.arguments, strict=True)) if events else {}
        return [substitute_atom(event, bindings) for event in events]

    def bits(self, atoms: tuple[int, ...]) -> Bits:
        """The bitset of a few atoms. A single atom always gives the same object."""
        if len(atoms) > 1:
            return bitset(atoms)
        found = self._sets.get(atoms)
        if found is None:
            found = self._sets[atoms] = bitset(atoms)
        return found

    def contradicts(self, operator: Operator, instance: Function, atoms: Bits, adds: Bits) -> None:
        """Notes a contradiction, unless the operator has one already."""
        self.contradictions.setdefault(operator.name, Contradiction(operator, instance, atoms, adds))

    def _conditional(
        self, operator: Operator, instance: Function, arguments: tuple[int, ...], required: Sequence[int]
    ) -> Iterator[ConditionalEffect]:
        if not any(map(is_conditional, operator.effects)):
            return
        for conditions, adds, deletes in self.effects.get((operator.name, arguments), ()):
            for support in self.supports.combinations(conditions):
                before = self.numbering.bits(each for each in (*support, *required) if self._is_fluent(each))
                added, denied = self.deduction.close(adds, before)
                if added & denied:
                    self.contradicts(operator, instance, added & denied, adds)
                self.numbering.bits([~each for each in support])  # makes complements, for regression
                yield ConditionalEffect(self.numbering.bits(support), added, (denied | deletes) & ~added)

        for conditions, advance in self.batches.advances(operator.name, arguments):
            for support in self.supports.combinations(conditions):
                bits = self.numbering.bits(support)
                yield ConditionalEffect(bits, advance.adds, advance.deletes)

    def _is_fluent(self, number: int) -> bool:
        return 0 <= number < len(self.universe.atoms)


class _Closing:
    """The changes of the instances of a schema. Equal changes are computed once."""

    def __init__(self, made: Instances, rows: InstanceRows) -> None:
        self.made, self.operator = made, rows.schema.operator
        _, self.literals, self.adds = rows.ends
        self.known: dict[tuple[tuple[int, ...], Bits], Changes] = {}

    def changes(self, row: list[int], base: Bits, instance: Function) -> Changes:
        """What the instance in `row` adds and deletes when its preconditions are `base`."""
        made = self.made
        before = base & made.triggers
        key = (tuple(row[self.literals :]), before)
        changes = self.known.get(key)
        if changes is None:
            changes = self.known[key] = self._closed(row, before, instance)
        if changes.doubtful:
            made.doubts.append(Doubt(instance, changes.doubtful, base))
        return changes

    def _closed(self, row: list[int], before: Bits, instance: Function) -> Changes:
        made = self.made
        adds = made.bits(tuple(row[self.literals : self.adds]))
        deletes = made.bits(tuple([atom for atom in row[self.adds :] if atom >= 0]))
        if deletes & adds:  # an atom that is both deleted and added stays true
            deletes &= ~adds
        if not made.deduces:
            return Changes(adds, deletes)
        added, denied = made.deduction.close(adds, before, deletes)
        if added & denied:
            made.contradicts(self.operator, instance, added & denied, adds)
        ends = denied | deletes
        return Changes(added, ends & ~added, ends & made.triggers & ~before)
