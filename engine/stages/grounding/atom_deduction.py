"""Deduction over numbered atoms: what each atom implies and denies, and the closure of changes.

clingo evaluates each deductive rule and returns tables of atom numbers. A consequence may have
variables of its own, as in `denies: at(Arm, Other), Other != Point`. It then relates one trigger to
every other atom of a pattern, so the number of pairs grows with the square of the number of atoms.
To avoid this, clingo lists triggers and consequences in separate tables. Both tables contain a key:
the number of the values that trigger and consequence share. All triggers with the same key have the
same bitset of consequences. Only the pairs that an inequality excludes are listed one by one.
"""

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from cellwright.engine.kernels.bits import Bits, bitset, indices
from cellwright.engine.stages.grounding.grounding_program import (
    ChangingPredicates,
    consequence_body,
    numbered_literal,
    rule_text,
)
from cellwright.engine.stages.grounding.numbered_atoms import Universe
from cellwright.kb.asp.integer_tables import IntegerTable
from cellwright.kb.asp.static_program import type_guard
from cellwright.kb.model.condition_forms import free_variables
from cellwright.kb.model.conditions import Aggregate, BodyPart, Comparison
from cellwright.kb.model.domain_model import Consequence, DeductiveOperator, Domain
from cellwright.kb.terms import ANYTHING, Function, Term, Variable, term_variables

Kind = tuple[bool, bool]  # (the trigger is added, the consequence is implied); False means denied
TRIGGER, CONSEQUENCE, KEY = "Trigger__", "Consequence__", "Key__"


@dataclass(frozen=True, slots=True)
class Sides:
    """A consequence that is split into two sides, so that each side gets a table of its own.

    `shared` are the variables that occur on both sides. `trigger` and `own` are the conditions of
    the trigger and of the consequence. `excluded` are equalities; the pairs that satisfy one of
    them do not count.
    """

    shared: tuple[Variable, ...]
    trigger: tuple[str, ...]
    own: tuple[str, ...]
    excluded: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _ConsequenceEntry:
    """One consequence of one deductive operator.

    The names of its auxiliary predicates begin with `name`.
    """

    name: str
    operator: DeductiveOperator
    consequence: Consequence
    sides: Sides | None

    @property
    def kind(self) -> Kind:
        return self.operator.trigger.positive, self.consequence.implied


def direct_consequences(
    domain: Domain, vocabulary: ChangingPredicates, universe: Universe
) -> Mapping[Kind, list[Bits]]:
    """The direct consequences of each fluent of `universe`, for each kind of trigger and
    consequence.
    """
    entries = list(_consequence_entries(domain, vocabulary))
    _number_keys([entry for entry in entries if entry.sides is not None], universe)
    tables = universe.tables(dict(itertools.chain.from_iterable(map(_entry_rules, entries))))
    masks_by_kind: dict[Kind, list[Bits]] = {
        (positive, implied): [0] * len(universe.atoms)
        for positive in (True, False)
        for implied in (True, False)
    }
    for entry in entries:
        masks = masks_by_kind[entry.kind]
        if entry.sides is None:
            for trigger, mask in _group_rows(tables[entry.name]).items():
                masks[trigger] |= mask
            continue
        triggers, own = tables[f"{entry.name}_from"], _group_rows(tables[f"{entry.name}_to"])
        excluded = _group_rows(tables[f"{entry.name}_but"])
        for key, trigger in triggers:
            masks[trigger] |= own.get(key, 0) & ~excluded.get(trigger, 0)
    return masks_by_kind


def split_sides(operator: DeductiveOperator, consequence: Consequence) -> Sides | None:
    """The two sides of a consequence.

    None if the consequence has no variables of its own, or if a condition other than an inequality
    joins the two sides.
    """
    near, far = _named_variables(operator.trigger.atom), _named_variables(consequence.atom)
    if far <= near:
        return None
    trigger: list[str] = []
    own: list[str] = []
    excluded: list[str] = []
    for part in (*operator.body, *consequence.body):
        names = set(free_variables(part))
        if isinstance(part, Aggregate) or not names <= near | far:
            return None
        if names <= near or names <= far:
            (trigger if names <= near else own).append(str(part))
        elif (equality := _excluded_equality(part)) is not None:
            excluded.append(equality)
        else:
            return None
    for parameter in consequence.parameters:
        (trigger if parameter.variable in near else own).extend(type_guard([parameter]))
    shared = tuple(sorted(near & far, key=str))
    return Sides(shared, tuple(trigger), tuple(own), tuple(excluded))


def _named_variables(atom: Function) -> set[Variable]:
    return set(term_variables(atom)) - {ANYTHING}


def _excluded_equality(part: BodyPart) -> str | None:
    """The equality that an inequality rules out; None for any other condition."""
    if isinstance(part, Comparison) and part.relation == "!=":
        return str(Comparison(part.left, "=", part.right))
    return None


def _consequence_entries(
    domain: Domain, vocabulary: ChangingPredicates
) -> Iterator[_ConsequenceEntry]:
    for number, operator in enumerate(domain.deductive_operators):
        if operator.trigger.atom.name not in vocabulary.events:
            for place, consequence in enumerate(operator.consequences):
                yield _ConsequenceEntry(
                    f"_c_{number}_{place}",
                    operator,
                    consequence,
                    split_sides(operator, consequence),
                )


def _number_keys(entries: list[_ConsequenceEntry], universe: Universe) -> None:
    """Numbers the values that the two sides of each entry share."""
    rules, arities = [], {}
    for entry in entries:
        assert entry.sides is not None
        name, shared = f"{entry.name}_key", entry.sides.shared
        trigger = numbered_literal(entry.operator.trigger.atom, TRIGGER)
        rules.append(rule_text(str(Function(name, shared)), [trigger, *entry.sides.trigger]))
        arities[name] = len(shared)
    universe.number(rules, arities)


def _entry_rules(entry: _ConsequenceEntry) -> Iterator[tuple[str, tuple[str, int]]]:
    trigger = numbered_literal(entry.operator.trigger.atom, TRIGGER)
    own = numbered_literal(entry.consequence.atom, CONSEQUENCE)
    if entry.sides is None:
        body = [trigger, own, *consequence_body(entry.operator, entry.consequence)]
        yield _pair_rule(entry.name, TRIGGER, CONSEQUENCE, [body])
        return
    split = entry.sides
    key = str(Function(f"{entry.name}_key_number", (*split.shared, Variable(KEY))))
    yield _pair_rule(f"{entry.name}_from", KEY, TRIGGER, [[key, trigger, *split.trigger]])
    yield _pair_rule(f"{entry.name}_to", KEY, CONSEQUENCE, [[key, own, *split.own]])
    both = [trigger, own, *split.trigger, *split.own]
    yield _pair_rule(
        f"{entry.name}_but",
        TRIGGER,
        CONSEQUENCE,
        [[*both, equality] for equality in split.excluded],
    )


def _pair_rule(
    name: str, first_column: str, second_column: str, bodies: list[list[str]]
) -> tuple[str, tuple[str, int]]:
    head: tuple[Term, ...] = (Variable(first_column), Variable(second_column))
    rules = [rule_text(str(Function(name, head)), body) for body in bodies]
    return name, (" ".join((f"#defined {name}/2.", *rules)), 2)


def _group_rows(table: IntegerTable) -> dict[int, Bits]:
    """For each number in the first column the numbers beside it, as a bitset.

    The rows come sorted.
    """
    groups = itertools.groupby(table, key=lambda row: row[0])
    return {first: bitset([second for _, second in group]) for first, group in groups}


Closure = tuple[Bits, Bits]


@dataclass(frozen=True, slots=True)
class Deduction:
    """The consequences of each atom, by atom number.

    `implied` and `denied` are what follows, over any number of rules, when the atom becomes true.
    `implied_if_denied` and `denied_if_denied` are what follows directly when the atom is denied.
    """

    implied: tuple[Bits, ...]
    denied: tuple[Bits, ...]
    implied_if_denied: tuple[Bits, ...]
    denied_if_denied: tuple[Bits, ...]

    def close(self, adds: Bits, true_before: Bits, deletes: Bits = 0) -> Closure:
        """The least fixpoint (Add, Del) of the atoms `adds` and the explicitly deleted atoms
        `deletes`.

        `deletes` is not part of the Del that is returned. A denied or deleted atom triggers `not`
        rules only if it is in `true_before`.
        """
        added, deleted = self._spread(adds)
        fired = 0
        while triggers := (deleted | deletes) & true_before & ~fired:
            fired |= triggers
            for atom in indices(triggers):
                deleted |= self.denied_if_denied[atom]
                more, denied = self._spread(self.implied_if_denied[atom])
                added, deleted = added | more, deleted | denied
        return added, deleted

    def has_rules(self) -> bool:
        """Whether any atom has consequences."""
        trivial = all(mask == 1 << atom for atom, mask in enumerate(self.implied))
        return not trivial or any(self.denied) or bool(self.triggers())

    def triggers(self) -> Bits:
        """The atoms whose denial has consequences."""
        pairs = zip(self.implied_if_denied, self.denied_if_denied, strict=True)
        return bitset([atom for atom, (implied, denied) in enumerate(pairs) if implied or denied])

    def _spread(self, adds: Bits) -> Closure:
        added = deleted = 0
        for atom in indices(adds):
            added |= self.implied[atom]
            deleted |= self.denied[atom]
        return added, deleted


def build_deduction(
    domain: Domain, vocabulary: ChangingPredicates, universe: Universe
) -> Deduction:
    """The deductive operators of `domain`, evaluated over the atoms of `universe`."""
    direct = direct_consequences(domain, vocabulary, universe)
    implied = _transitive_closure(direct[(True, True)])
    own_denied = direct[(True, False)]
    denied = [_union_masks(own_denied, reached) for reached in implied]
    return Deduction(
        tuple(implied), tuple(denied), tuple(direct[(False, True)]), tuple(direct[(False, False)])
    )


def _union_masks(masks: list[Bits], over: Bits) -> Bits:
    union = 0
    for index in indices(over):
        union |= masks[index]
    return union


def _transitive_closure(direct: list[Bits]) -> list[Bits]:
    """For each atom everything that it implies, directly or over other atoms; the atom itself
    is included.
    """
    closed = []
    for atom, implied in enumerate(direct):
        reached, frontier = 1 << atom, implied & ~(1 << atom)
        while frontier:
            reached |= frontier
            frontier = _union_masks(direct, frontier) & ~reached
        closed.append(reached)
    return closed
