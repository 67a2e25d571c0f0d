"""Ground steps, prepared as far as they do not depend on a state.

Every plan that has the step uses the same result. This works for operators whose precondition names all its
atoms and whose effects have no conditions on the state. `cellwright.engine.stages.macros.lifted.world` executes the
other operators. It gives the same answers for all operators, but slower.
"""

from collections.abc import Collection, Iterator
from dataclasses import dataclass

from cellwright.engine.stages.macros.lifted.bodies import Bindings, satisfiable, solve
from cellwright.engine.stages.macros.lifted.facts import Facts
from cellwright.engine.stages.macros.lifted.schema import Following, OperatorSchema, Schemas
from cellwright.kb.model.conditions import Body, BodyPart, Literal, part_variables, substitute_part
from cellwright.kb.terms import Atom, is_ground, match, substitute_atom

Needed = tuple[tuple[Atom, ...], tuple[Atom, ...]]  # atoms that must hold, and atoms that must not


@dataclass(frozen=True, slots=True)
class GroundStep:
    """A ground step in any state. With a `refusal`, a reason against the step, no state allows it.

    Each of `sweeps` ends the atoms of the state that match a pattern, if a guard holds for them.
    """

    refusal: str
    alternatives: tuple[Needed, ...]
    adds: tuple[Atom, ...]
    ends: tuple[Atom, ...]
    sweeps: tuple[tuple[Atom, Body], ...]
    events: tuple[Atom, ...] = ()

    def applicable(self, facts: Facts) -> bool:
        """Whether the precondition holds in a state."""
        return any(
            all(atom in facts for atom in holding) and not any(atom in facts for atom in absent)
            for holding, absent in self.alternatives
        )

    def ended(self, facts: Facts, statics: Facts) -> tuple[Atom, ...]:
        """The atoms of a state that the step ends."""
        found = dict.fromkeys(atom for atom in self.ends if atom in facts)
        for pattern, guard in self.sweeps:
            for atom in facts.matching(pattern):
                if atom not in self.adds and _swept(pattern, guard, atom, statics):
                    found[atom] = None
        return tuple(found)


def _swept(pattern: Atom, guard: Body, atom: Atom, statics: Facts) -> bool:
    found = match(pattern, atom, {})
    return found is not None and satisfiable(guard, statics, found)


def is_plain(schema: OperatorSchema, schemas: Schemas) -> bool:
    """Whether the instances of an operator can be prepared without a state."""
    header = set(schema.operator.variables)
    return not any(each.needs for each in (*schema.adds, *schema.denies, *schema.batches)) and all(
        isinstance(part, Literal)
        and schemas.is_dynamic(part)
        and not schemas.is_derived(part.atom)
        and header.issuperset(part_variables(part))
        for body in schema.alternatives
        for part in body
    )


def ground_step(schema: OperatorSchema, bindings: Bindings, statics: Facts) -> GroundStep:
    """The instance of a plain operator under `bindings`."""
    if not satisfiable(schema.body, statics, bindings):
        return GroundStep("its constraints do not hold", (), (), (), ())
    adds = tuple(
        dict.fromkeys(
            substitute_atom(each.atom, found)
            for each in schema.adds
            for found in solve(each.guard, statics, bindings)
        )
    )
    denied = [(each, *_seen(each, bindings)) for each in schema.denies]
    ends = {pattern: None for _, pattern, guard in denied if _ends(pattern, guard, adds, statics)}
    sweeps = {(p, guard): None for _, p, guard in denied if not is_ground(p) and _possible(guard, statics)}
    clash = next(_clashes(denied, adds, statics), None)
    return GroundStep(
        f"it adds and denies {clash}" if clash is not None else "",
        tuple(_needed(body, bindings) for body in schema.alternatives),
        adds,
        tuple(ends),
        tuple((pattern, _open_parts(guard)) for pattern, guard in sweeps),
        tuple(substitute_atom(each, bindings) for each in schema.events),
    )


def _seen(each: Following, bindings: Bindings) -> tuple[Atom, Body]:
    """The atom of a denial and its guard, under the bindings of one instance."""
    return substitute_atom(each.atom, bindings), tuple(substitute_part(part, bindings) for part in each.guard)


def _ends(pattern: Atom, guard: Body, adds: Collection[Atom], statics: Facts) -> bool:
    return is_ground(pattern) and pattern not in adds and satisfiable(guard, statics, {})


def _possible(guard: Body, statics: Facts) -> bool:
    """Whether all parts of a guard hold, as far as they have no open variables."""
    return satisfiable(tuple(part for part in guard if not _is_open(part)), statics, {})


def _open_parts(guard: Body) -> Body:
    return tuple(filter(_is_open, guard))


def _is_open(part: BodyPart) -> bool:
    return (
        next(part_variables(part), None) is not None
        if not isinstance(part, Literal)
        else not is_ground(part.atom)
    )


def _clashes(
    denied: list[tuple[Following, Atom, Body]], adds: tuple[Atom, ...], statics: Facts
) -> Iterator[Atom]:
    for each, pattern, guard in denied:
        for atom in adds if each.deduced else ():
            if atom.name == pattern.name and _swept(pattern, guard, atom, statics):
                yield atom


def _needed(body: Body, bindings: Bindings) -> Needed:
    literals = [part for part in body if isinstance(part, Literal)]
    holding = tuple(substitute_atom(each.atom, bindings) for each in literals if each.positive)
    return holding, tuple(substitute_atom(each.atom, bindings) for each in literals if not each.positive)
