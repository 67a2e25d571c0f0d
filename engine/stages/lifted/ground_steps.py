"""Ground steps with all that does not depend on a state computed beforehand.

Every plan that has the step uses the same result. This works for operators whose precondition names
all its atoms and whose effects have no conditions on the state.
`cellwright.engine.stages.lifted.cell_domain` executes the other operators. It gives the same
answers for all operators, but slower.
"""

from collections.abc import Collection, Iterator
from dataclasses import dataclass

from cellwright.engine.stages.lifted.fact_queries import (
    Bindings,
    FactSet,
    is_satisfiable,
    solve_body,
)
from cellwright.engine.stages.lifted.operator_schemas import (
    GuardedAtom,
    OperatorSchema,
    OperatorSchemas,
)
from cellwright.kb.model.conditions import Body, BodyPart, Literal, part_variables, substitute_part
from cellwright.kb.terms import Atom, is_ground, match_term, substitute_atom

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

    def applicable(self, facts: FactSet) -> bool:
        """Whether the precondition holds in a state."""
        return any(
            all(atom in facts for atom in holding) and not any(atom in facts for atom in absent)
            for holding, absent in self.alternatives
        )

    def ended(self, facts: FactSet, statics: FactSet) -> tuple[Atom, ...]:
        """The atoms of a state that the step ends."""
        ended = dict.fromkeys(atom for atom in self.ends if atom in facts)
        for pattern, guard in self.sweeps:
            for atom in facts.matching(pattern):
                if atom not in self.adds and _is_swept(pattern, guard, atom, statics):
                    ended[atom] = None
        return tuple(ended)


def _is_swept(pattern: Atom, guard: Body, atom: Atom, statics: FactSet) -> bool:
    bindings = match_term(pattern, atom, {})
    return bindings is not None and is_satisfiable(guard, statics, bindings)


def is_plain(schema: OperatorSchema, schemas: OperatorSchemas) -> bool:
    """Whether the instances of an operator can be prepared without a state."""
    header = set(schema.operator.variables)
    return not any(
        guarded.needs for guarded in (*schema.adds, *schema.denies, *schema.batches)
    ) and all(
        isinstance(part, Literal)
        and schemas.is_dynamic(part)
        and not schemas.is_derived(part.atom)
        and header.issuperset(part_variables(part))
        for body in schema.alternatives
        for part in body
    )


def ground_step(schema: OperatorSchema, bindings: Bindings, statics: FactSet) -> GroundStep:
    """The instance of a plain operator under `bindings`."""
    if not is_satisfiable(schema.body, statics, bindings):
        return GroundStep("its constraints do not hold", (), (), (), ())
    adds = tuple(
        dict.fromkeys(
            substitute_atom(addition.atom, solution)
            for addition in schema.adds
            for solution in solve_body(addition.guard, statics, bindings)
        )
    )
    denied = [(denial, *_instance_denial(denial, bindings)) for denial in schema.denies]
    ends = {
        pattern: None for _, pattern, guard in denied if _ends_atoms(pattern, guard, adds, statics)
    }
    sweeps = {
        (p, guard): None
        for _, p, guard in denied
        if not is_ground(p) and _is_possible(guard, statics)
    }
    clash = next(_clashing_atoms(denied, adds, statics), None)
    return GroundStep(
        f"it adds and denies {clash}" if clash is not None else "",
        tuple(_needed_atoms(body, bindings) for body in schema.alternatives),
        adds,
        tuple(ends),
        tuple((pattern, _open_parts(guard)) for pattern, guard in sweeps),
        tuple(substitute_atom(event, bindings) for event in schema.events),
    )


def _instance_denial(denial: GuardedAtom, bindings: Bindings) -> tuple[Atom, Body]:
    """The atom of a denial and its guard, under the bindings of one instance."""
    return substitute_atom(denial.atom, bindings), tuple(
        substitute_part(part, bindings) for part in denial.guard
    )


def _ends_atoms(pattern: Atom, guard: Body, adds: Collection[Atom], statics: FactSet) -> bool:
    return is_ground(pattern) and pattern not in adds and is_satisfiable(guard, statics, {})


def _is_possible(guard: Body, statics: FactSet) -> bool:
    """Whether all parts of a guard hold, as far as they have no open variables."""
    return is_satisfiable(tuple(part for part in guard if not _is_open(part)), statics, {})


def _open_parts(guard: Body) -> Body:
    return tuple(filter(_is_open, guard))


def _is_open(part: BodyPart) -> bool:
    return (
        next(part_variables(part), None) is not None
        if not isinstance(part, Literal)
        else not is_ground(part.atom)
    )


def _clashing_atoms(
    denied: list[tuple[GuardedAtom, Atom, Body]], adds: tuple[Atom, ...], statics: FactSet
) -> Iterator[Atom]:
    for denial, pattern, guard in denied:
        for atom in adds if denial.deduced else ():
            if atom.name == pattern.name and _is_swept(pattern, guard, atom, statics):
                yield atom


def _needed_atoms(body: Body, bindings: Bindings) -> Needed:
    literals = [part for part in body if isinstance(part, Literal)]
    holding = tuple(
        substitute_atom(literal.atom, bindings) for literal in literals if literal.positive
    )
    return holding, tuple(
        substitute_atom(literal.atom, bindings) for literal in literals if not literal.positive
    )
