"""What each atom implies and denies when it becomes true or false, as one bitset for each atom.

clingo evaluates each deductive rule and returns tables of atom numbers. A consequence may have variables of
its own, as in `denies: at(Arm, Other), Other != Point`. It then relates one trigger to every other atom of a
pattern, so the number of pairs grows with the square of the number of atoms. To avoid this, clingo lists
triggers and consequences in separate tables. Both tables contain a key: the number of the values that trigger
and consequence share. All triggers with the same key have the same bitset of consequences. Only the pairs
that an inequality excludes are listed one by one.
"""

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from cellwright.engine.model.task import Bits, bitset
from cellwright.engine.stages.grounding.program import Vocabulary, consequence_body, numbered, rule
from cellwright.engine.stages.grounding.universe import Universe
from cellwright.kb.asp.tables import Table
from cellwright.kb.asp.vocabulary import guard
from cellwright.kb.model.bindings import free_variables
from cellwright.kb.model.conditions import Aggregate, BodyPart, Comparison
from cellwright.kb.model.domain import Consequence, DeductiveOperator, Domain
from cellwright.kb.terms import ANYTHING, Function, Term, Variable, variables

Kind = tuple[bool, bool]  # (the trigger is added, the consequence is implied); False means denied
TRIGGER, CONSEQUENCE, KEY = "Trigger__", "Consequence__", "Key__"


@dataclass(frozen=True, slots=True)
class Sides:
    """A consequence that is split into two sides, so that each side gets a table of its own.

    `shared` are the variables that occur on both sides. `trigger` and `own` are the conditions of the trigger
    and of the consequence. `excluded` are equalities; the pairs that satisfy one of them do not count.
    """

    shared: tuple[Variable, ...]
    trigger: tuple[str, ...]
    own: tuple[str, ...]
    excluded: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _Entry:
    """One consequence of one deductive operator. The names of its auxiliary predicates begin with `name`."""

    name: str
    operator: DeductiveOperator
    consequence: Consequence
    sides: Sides | None

    @property
    def kind(self) -> Kind:
        return self.operator.trigger.positive, self.consequence.implied


def consequences(domain: Domain, vocabulary: Vocabulary, universe: Universe) -> Mapping[Kind, list[Bits]]:
    """The direct consequences of each fluent of `universe`, for each kind of trigger and consequence."""
    entries = list(_entries(domain, vocabulary))
    _number_keys([entry for entry in entries if entry.sides is not None], universe)
    tables = universe.tables(dict(itertools.chain.from_iterable(map(_rules, entries))))
    found: dict[Kind, list[Bits]] = {
        (positive, implied): [0] * len(universe.atoms)
        for positive in (True, False)
        for implied in (True, False)
    }
    for entry in entries:
        masks = found[entry.kind]
        if entry.sides is None:
            for trigger, mask in _grouped(tables[entry.name]).items():
                masks[trigger] |= mask
            continue
        triggers, own = tables[f"{entry.name}_from"], _grouped(tables[f"{entry.name}_to"])
        excluded = _grouped(tables[f"{entry.name}_but"])
        for key, trigger in triggers:
            masks[trigger] |= own.get(key, 0) & ~excluded.get(trigger, 0)
    return found


def sides(operator: DeductiveOperator, consequence: Consequence) -> Sides | None:
    """The two sides of a consequence.

    None if the consequence has no variables of its own, or if a condition other than an inequality joins the
    two sides.
    """
    near, far = _named(operator.trigger.atom), _named(consequence.atom)
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
        elif (equality := _excluded(part)) is not None:
            excluded.append(equality)
        else:
            return None
    for parameter in consequence.parameters:
        (trigger if parameter.variable in near else own).extend(guard([parameter]))
    shared = tuple(sorted(near & far, key=str))
    return Sides(shared, tuple(trigger), tuple(own), tuple(excluded))


def _named(atom: Function) -> set[Variable]:
    return set(variables(atom)) - {ANYTHING}


def _excluded(part: BodyPart) -> str | None:
    """The equality that an inequality rules out; None for any other condition."""
    if isinstance(part, Comparison) and part.relation == "!=":
        return str(Comparison(part.left, "=", part.right))
    return None


def _entries(domain: Domain, vocabulary: Vocabulary) -> Iterator[_Entry]:
    for number, operator in enumerate(domain.deductive_operators):
        if operator.trigger.atom.name not in vocabulary.events:
            for place, consequence in enumerate(operator.consequences):
                yield _Entry(f"_c_{number}_{place}", operator, consequence, sides(operator, consequence))


def _number_keys(entries: list[_Entry], universe: Universe) -> None:
    """Numbers the values that the two sides of each entry share."""
    rules, arities = [], {}
    for entry in entries:
        assert entry.sides is not None
        name, shared = f"{entry.name}_key", entry.sides.shared
        trigger = numbered(entry.operator.trigger.atom, TRIGGER)
        rules.append(rule(str(Function(name, shared)), [trigger, *entry.sides.trigger]))
        arities[name] = len(shared)
    universe.number(rules, arities)


def _rules(entry: _Entry) -> Iterator[tuple[str, tuple[str, int]]]:
    trigger = numbered(entry.operator.trigger.atom, TRIGGER)
    own = numbered(entry.consequence.atom, CONSEQUENCE)
    if entry.sides is None:
        body = [trigger, own, *consequence_body(entry.operator, entry.consequence)]
        yield _pairs(entry.name, TRIGGER, CONSEQUENCE, [body])
        return
    split = entry.sides
    key = str(Function(f"{entry.name}_key_number", (*split.shared, Variable(KEY))))
    yield _pairs(f"{entry.name}_from", KEY, TRIGGER, [[key, trigger, *split.trigger]])
    yield _pairs(f"{entry.name}_to", KEY, CONSEQUENCE, [[key, own, *split.own]])
    both = [trigger, own, *split.trigger, *split.own]
    yield _pairs(f"{entry.name}_but", TRIGGER, CONSEQUENCE, [[*both, each] for each in split.excluded])


def _pairs(name: str, one: str, other: str, bodies: list[list[str]]) -> tuple[str, tuple[str, int]]:
    head: tuple[Term, ...] = (Variable(one), Variable(other))
    rules = [rule(str(Function(name, head)), body) for body in bodies]
    return name, (" ".join((f"#defined {name}/2.", *rules)), 2)


def _grouped(table: Table) -> dict[int, Bits]:
    """For each number in the first column the numbers beside it, as a bitset. The rows come sorted."""
    groups = itertools.groupby(table, key=lambda row: row[0])
    return {first: bitset([second for _, second in group]) for first, group in groups}
