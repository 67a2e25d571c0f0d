"""Safety of a proof: excludes what would make an instance of the generalised plan fail.

This may be a threat to a link, a contradiction, or interference between unordered steps. If it
could happen for some binding, the weakest condition that held in the original plan excludes it;
most often, that two terms differ. So two terms must differ only if some step needs it.
"""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, field

from cellwright.engine.stages.lifted.fact_queries import is_satisfiable
from cellwright.engine.stages.lifted.operator_schemas import GuardedAtom, NotGeneral
from cellwright.engine.stages.macros.learning.plan_proof import PlanProof, SupportedLiteral
from cellwright.engine.stages.macros.learning.term_equalities import (
    make_disequality,
    simplify_body,
    weakest_equations,
)
from cellwright.kb.model.condition_forms import RELATION_NEGATIONS
from cellwright.kb.model.conditions import (
    Body,
    BodyPart,
    Comparison,
    Literal,
    part_variables,
    substitute_part,
)
from cellwright.kb.model.plan_model import GOAL_STEP, INITIAL_STEP, StepId
from cellwright.kb.terms import Function, Term, Variable, substitute_term

Pairs = list[tuple[Term, Term]]


@dataclass
class ProofSafety:
    """The conditions that keep a proof's instances safe."""

    proof: PlanProof
    disequalities: dict[Comparison, None] = field(default_factory=dict)
    negated: dict[BodyPart, None] = field(default_factory=dict)
    exclusions: dict[Body, None] = field(default_factory=dict)
    _constrained: set[Comparison] = field(default_factory=set)
    _constrained_at: tuple[int, int] | None = None

    def establish(self) -> None:
        """Exclude everything that could go wrong.

        Repeat while this makes terms equal or adds needs.
        """
        while True:
            known_sizes = (len(self.proof.equal.bindings), len(self.proof.needs))
            self.disequalities.clear()
            self.negated.clear()
            self.exclusions.clear()
            for threat in [
                *self._threats(),
                *self._taken_back(),
                *self._contradictions(),
                *self._interference(),
            ]:
                self._exclude(*threat)
            if known_sizes == (len(self.proof.equal.bindings), len(self.proof.needs)):
                return

    def _threats(self) -> Iterator[tuple[Pairs, GuardedAtom, StepId]]:
        """Threats: steps that may come between the ends of a link, with a consequence that ends
        it.
        """
        denied = self._by_predicate(False)
        added = self._by_predicate(True)
        for need in self.proof.needs:
            threats = denied if need.positive else added
            for step, threat in threats.get(need.atom.name, ()):
                if self._between(step, need):
                    yield [(threat.atom, need.atom)], threat, step

    def _taken_back(self) -> Iterator[tuple[Pairs, GuardedAtom, StepId]]:
        """Additions of a step that could undo its own denials.

        A step may deny one atom and add another of the same predicate. Under some bindings they are
        the same atom. Then the atom is true after the step, although a later step needs it to be
        false.
        """
        for need in self.proof.needs:
            if not need.positive and need.producer != INITIAL_STEP:
                for added in self.proof.schemas[need.producer].adds:
                    if added.atom.name == need.atom.name:
                        yield [(added.atom, need.atom)], added, need.producer

    def _by_predicate(self, adds: bool) -> dict[str, list[tuple[StepId, GuardedAtom]]]:
        guarded_atoms: dict[str, list[tuple[StepId, GuardedAtom]]] = {}
        for step, schema in self.proof.schemas.items():
            for guarded in schema.adds if adds else schema.denies:
                guarded_atoms.setdefault(guarded.atom.name, []).append((step, guarded))
        return guarded_atoms

    def _between(self, step: StepId, need: SupportedLiteral) -> bool:
        if step in (need.producer, need.consumer):
            return False
        early = need.producer != INITIAL_STEP and step in self.proof.before[need.producer]
        late = need.consumer != GOAL_STEP and need.consumer in self.proof.before[step]
        return not early and not late

    def _contradictions(self) -> Iterator[tuple[Pairs, GuardedAtom, StepId]]:
        for step, schema in self.proof.schemas.items():
            for denied in schema.denies:
                for added in schema.adds if denied.deduced else ():
                    if added.atom.name == denied.atom.name:
                        yield (*_rename_apart(self.proof, denied, added), step)

    def _interference(self) -> Iterator[tuple[Pairs, GuardedAtom, StepId]]:
        """Interference: unordered steps that share a resource, or where one denies what the
        other adds.
        """
        resources = {
            step: [substitute_term(r, self.proof.header(step)) for r in schema.operator.resources]
            for step, schema in self.proof.schemas.items()
        }
        for first_id, second_id in itertools.combinations(self.proof.schemas, 2):
            if first_id in self.proof.before[second_id] or second_id in self.proof.before[first_id]:
                continue
            for pair in itertools.product(resources[first_id], resources[second_id]):
                yield [pair], GuardedAtom(Function("resource")), first_id
            for step, rival in ((first_id, second_id), (second_id, first_id)):
                yield from self._denials(step, rival)

    def _denials(self, step: StepId, rival: StepId) -> Iterator[tuple[Pairs, GuardedAtom, StepId]]:
        for denied in self.proof.schemas[step].denies:
            for added in self.proof.schemas[rival].adds:
                if added.atom.name == denied.atom.name:
                    yield (*_rename_apart(self.proof, denied, added), step)

    def _exclude(self, pairs: Pairs, cause: GuardedAtom, step: StepId) -> None:
        """Demand a condition under which the pairs are never all equal while the guard of
        `cause` holds.
        """
        parts = self.firing(pairs, cause.guard)
        if parts is None or (cause.needs and self._prevented(parts, cause, step)):
            return
        origin = self.proof.origin
        if self.excluded(parts):
            return
        own = [part for part in parts if all(v in origin for v in part_variables(part))]
        false = [part for part in own if not self._true(part)]
        if false:
            self._negate(false)
        elif is_satisfiable(parts, self.proof.world.statics, self._values(parts)):
            raise NotGeneral(
                f"step {step} {cause.atom}: the original plan itself does not exclude this"
            )
        else:
            self.exclusions[tuple(part for part in parts if part not in own) or parts] = None

    def excluded(self, parts: Body) -> bool:
        """Whether a condition that is already demanded prevents the parts from holding together."""
        equal = [part for part in parts if isinstance(part, Comparison) and part.relation == "="]
        return any(self._known_apart(part) for part in equal) or any(
            isinstance(part, Literal) and _negate_part(part) in self.negated for part in parts
        )

    def _known_apart(self, part: Comparison) -> bool:
        """Whether a disequality or a constraint says that the two terms of an equation differ."""
        differ = make_disequality(part.left, part.right)
        if differ in self.disequalities:
            return True
        size = (len(self.proof.constraints), len(self.proof.equal.bindings))
        if self._constrained_at != size:
            demanded = map(self._resolved, filter(_is_apart, self.proof.constraints))
            self._constrained = {
                make_disequality(comparison.left, comparison.right)
                for comparison in demanded
                if isinstance(comparison, Comparison)
            }
            self._constrained_at = size
        return differ in self._constrained

    def firing(self, pairs: Pairs, guard: Body) -> Body | None:
        """The condition that all pairs are equal and the guard holds, simplified; None if never
        true.
        """
        equal = self.proof.equal
        unifier = weakest_equations(
            [
                (equal.resolved(first_term), equal.resolved(second_term))
                for first_term, second_term in pairs
            ]
        )
        if unifier is None:
            return None
        origin = self.proof.origin
        local = {variable: term for variable, term in unifier.items() if variable not in origin}
        own = [
            Comparison(variable, "=", term)
            for variable, term in unifier.items()
            if variable in origin
        ]
        resolved = [substitute_part(self._resolved(part), local) for part in guard]
        return simplify_body((*own, *resolved))

    def _resolved(self, part: BodyPart) -> BodyPart:
        return self.proof.equal.part(part, part_variables(part))

    def _values(self, parts: Body) -> dict[Variable, Term]:
        used = {variable for part in parts for variable in part_variables(part)}
        return {
            variable: self.proof.origin[variable]
            for variable in used
            if variable in self.proof.origin
        }

    def _true(self, part: BodyPart) -> bool:
        return is_satisfiable((part,), self.proof.world.statics, self._values((part,)))

    def _prevented(self, parts: Body, cause: GuardedAtom, step: StepId) -> bool:
        """Whether a conditional effect does not happen because one of its conditions is false.

        The step then needs that.
        """
        if not is_satisfiable(parts, self.proof.world.statics, self._values(parts)):
            return False
        state = self.proof.states[step]
        for part in cause.needs:
            if not isinstance(part, Literal) or any(
                v not in self.proof.origin for v in part_variables(part)
            ):
                continue
            if not is_satisfiable((part,), state, self._values((part,))):
                self.proof.need(part.atom, not part.positive, step)
                return True
        return False

    def _negate(self, false: list[BodyPart]) -> None:
        """Add the weakest negation of the parts.

        This is the first that is possible: terms differ, a comparison is negated, a static fact is
        negated, terms are equal.
        """
        equal = [part for part in false if isinstance(part, Comparison) and part.relation == "="]
        comparisons = [
            part
            for part in false
            if isinstance(part, Comparison) and part.relation not in ("=", "!=")
        ]
        literals = [part for part in false if isinstance(part, Literal)]
        if equal:
            self.disequalities[_some_difference(equal)] = None
        elif comparisons or literals:
            self.negated[_negate_part((comparisons or literals)[0])] = None
        else:
            part = false[0]
            assert isinstance(part, Comparison)
            self.proof.equal.join(part.left, part.right)


def _rename_apart(
    proof: PlanProof, denied: GuardedAtom, added: GuardedAtom
) -> tuple[Pairs, GuardedAtom]:
    """A denial and an addition of the same atom, as one cause.

    The addition has its own local variables.
    """
    own = proof.apart(added)
    guard, needs = (*denied.guard, *own.guard), (*denied.needs, *own.needs)
    return [(denied.atom, own.atom)], GuardedAtom(denied.atom, guard, needs)


def _negate_part(part: BodyPart) -> BodyPart:
    match part:
        case Comparison(left, "=", right):
            return make_disequality(left, right)
        case Comparison(left, relation, right):
            return Comparison(left, RELATION_NEGATIONS[relation], right)
        case Literal(atom, positive):
            return Literal(atom, not positive)
        case _:
            raise NotGeneral(f"{part} cannot be negated")


def _is_apart(part: BodyPart) -> bool:
    return isinstance(part, Comparison) and part.relation == "!="


def _some_difference(equal: list[Comparison]) -> Comparison:
    if len(equal) == 1:
        return make_disequality(equal[0].left, equal[0].right)
    left, right = (
        Function("", tuple(getattr(comparison, side) for comparison in equal))
        for side in ("left", "right")
    )
    return Comparison(left, "!=", right)
