"""Rows of numbers from clingo become ground operators: conditions, supports, deduction, workflow stages."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

from engine.grounding.closure import Deduction
from engine.grounding.derived import Support, Supports
from engine.grounding.program import Schema, is_conditional
from engine.grounding.universe import DERIVED, Universe
from engine.grounding.workflow import Workflow
from engine.model.task import Bits, ConditionalEffect, GroundOperator, bitset
from kb.model.domain import Operator
from kb.terms import Function, Number, Substitution, Term, substitute, substitute_atom


@dataclass
class Numbering:
    """Bits of signed atoms: fluents keep their numbers, a negated one gets a complementary atom when first asked for."""

    size: int
    complements: dict[int, int] = field(default_factory=dict)

    def bits(self, support: Support | tuple[int, ...]) -> Bits:
        """The bitset of a set of signed numbers."""
        return bitset([self._position(signed) for signed in support])

    def _position(self, signed: int) -> int:
        if signed >= 0:
            return signed
        return self.complements.setdefault(~signed, self.size + len(self.complements))

    def complements_of(self, atoms: Bits) -> Bits:
        """The complementary atoms of those that have one."""
        return bitset([complement for atom, complement in self.complements.items() if atoms >> atom & 1])

    def kept(self, adds: Bits, deletes: Bits) -> tuple[Bits, Bits]:
        """The effects with those on complementary atoms: what is added is no longer false, and the reverse."""
        more_adds, more_deletes = adds, deletes
        for atom, complement in self.complements.items():
            if adds >> atom & 1:
                more_deletes |= 1 << complement
            elif deletes >> atom & 1:
                more_adds |= 1 << complement
        return more_adds, more_deletes


@dataclass(frozen=True, slots=True)
class Contradiction:
    """An operator instance whose consequences both add and deny `atoms`."""

    operator: Operator
    instance: Function
    atoms: Bits
    adds: Bits


@dataclass(frozen=True, slots=True)
class Doubt:
    """An instance denies `atoms` with consequences; whether they were true its `preconditions` may say or not."""

    instance: Function
    atoms: Bits
    preconditions: Bits


@dataclass(frozen=True, slots=True)
class Row:
    """One instance of a schema before negation and supports are compiled: signed numbers."""

    schema: Schema
    arguments: tuple[int, ...]
    conditions: tuple[int, ...]
    adds: Bits
    deletes: Bits


@dataclass
class Instances:
    """Everything needed to turn rows into operators, and the contradictions met on the way."""

    universe: Universe
    deduction: Deduction
    supports: Supports
    workflow: Workflow
    numbering: Numbering
    effects: Mapping[tuple[str, tuple[int, ...]], list[tuple[tuple[int, ...], Bits, Bits]]]
    contradictions: list[Contradiction] = field(default_factory=list)
    doubts: list[Doubt] = field(default_factory=list)
    _closed: dict[tuple[Bits, Bits, Bits], tuple[Bits, Bits]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.triggers = self.deduction.triggers()
        self.deduces = self.deduction.has_rules()

    def operators(self, row: Row) -> Iterator[GroundOperator]:
        """The ground operators of one row: one per support and per choice of stages."""
        operator = row.schema.operator
        bindings = dict(zip(operator.variables, (self.universe.terms[n] for n in row.arguments), strict=True))
        instance = Function(operator.name, tuple(bindings.values()))
        resources = tuple(substitute(resource, bindings) for resource in operator.resources)
        duration, cost = value(operator.duration, bindings, 0), value(operator.cost, bindings, 1)
        events = [
            substitute_atom(e.atom, bindings) for e in operator.effects if e.atom.name in self.workflow.events
        ]
        conditional = tuple(self._conditional(row, operator, instance))
        for support in self.supports.combinations(row.conditions):
            true_before = bitset([signed for signed in support if 0 <= signed < DERIVED])
            added, deleted = self._close(row, operator, instance, true_before)
            base = self.numbering.bits(support)
            self._doubt(row, instance, true_before, base)
            for advance in self.workflow.advances(events, added):
                yield GroundOperator(
                    instance,
                    base | advance.conditions,
                    added | advance.adds,
                    deleted | advance.deletes,
                    conditional,
                    resources,
                    duration,
                    cost,
                )

    def _close(
        self, row: Row, operator: Operator, instance: Function, true_before: Bits
    ) -> tuple[Bits, Bits]:
        deletes = row.deletes & ~row.adds  # add after delete: what is added again never ends
        if not self.deduces:
            return row.adds, deletes
        key = (row.adds, true_before, deletes)
        closed = self._closed.get(key)
        if closed is None:
            closed = self._closed[key] = self.deduction.close(row.adds, true_before, deletes)
        added, denied = closed
        if added & denied:
            self.contradictions.append(Contradiction(operator, instance, added & denied, row.adds))
        return added, (denied | deletes) & ~added

    def _doubt(self, row: Row, instance: Function, true_before: Bits, base: Bits) -> None:
        """Note denied atoms with consequences that the preconditions do not name."""
        if not self.triggers:
            return
        deletes = row.deletes & ~row.adds
        _, denied = self._closed[(row.adds, true_before, deletes)]
        doubtful = (denied | deletes) & self.triggers & ~true_before
        if doubtful:
            self.doubts.append(Doubt(instance, doubtful, base))

    def _conditional(self, row: Row, operator: Operator, instance: Function) -> Iterator[ConditionalEffect]:
        if not any(map(is_conditional, operator.effects)):
            return
        for conditions, adds, deletes in self.effects.get((operator.name, row.arguments), ()):
            for support in self.supports.combinations(conditions):
                true_before = bitset(
                    [signed for signed in (*support, *row.conditions) if 0 <= signed < DERIVED]
                )
                added, denied = self.deduction.close(adds, true_before)
                if added & denied:
                    self.contradictions.append(Contradiction(operator, instance, added & denied, adds))
                self.numbering.bits(
                    tuple(~signed for signed in support)
                )  # regression needs their complements
                yield ConditionalEffect(self.numbering.bits(support), added, (denied | deletes) & ~added)


def value(term: Term | None, bindings: Substitution, default: int) -> int:
    """A duration or cost under bindings."""
    bound = substitute(term, bindings) if term is not None else None
    return bound.value if isinstance(bound, Number) else default


def complemented(operator: GroundOperator, numbering: Numbering) -> GroundOperator:
    """The operator with effects on complementary atoms; to be called when all complements are known."""
    if not numbering.complements:
        return operator
    adds, deletes = numbering.kept(operator.adds, operator.deletes)
    conditional = tuple(_completed(effect, operator.adds, numbering) for effect in operator.conditional)
    return replace(operator, adds=adds, deletes=deletes, conditional=conditional)


def _completed(effect: ConditionalEffect, added: Bits, numbering: Numbering) -> ConditionalEffect:
    """The effect on complementary atoms, too; what the operator adds in any case, the effect cannot delete."""
    adds, deletes = numbering.kept(effect.adds, effect.deletes & ~added)
    return ConditionalEffect(effect.condition, adds, deletes, numbering.complements_of(effect.adds))
