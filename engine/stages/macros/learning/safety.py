"""Excludes what would make an instance of a plan fail.

This may be a threat to a link, a contradiction, or interference between unordered steps. If it could happen
for some binding, the weakest condition that held in the original plan excludes it; most often, that two terms
differ. So two terms must differ only if some step needs it.
"""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, field

from cellwright.engine.stages.macros.learning.proof import Proof, SupportedLiteral
from cellwright.engine.stages.macros.learning.terms import apart, equations, simplified
from cellwright.engine.stages.macros.lifted.bodies import satisfiable
from cellwright.engine.stages.macros.lifted.schema import Following, NotGeneral
from cellwright.kb.model.conditions import (
    Body,
    BodyPart,
    Comparison,
    Literal,
    part_variables,
    substitute_part,
)
from cellwright.kb.model.normalise import NEGATED
from cellwright.kb.model.plan import GOAL, START, StepId
from cellwright.kb.terms import Function, Term, Variable, substitute

Pairs = list[tuple[Term, Term]]


@dataclass
class Safety:
    """The conditions that keep a proof's instances safe."""

    proof: Proof
    disequalities: dict[Comparison, None] = field(default_factory=dict)
    negated: dict[BodyPart, None] = field(default_factory=dict)
    exclusions: dict[Body, None] = field(default_factory=dict)
    _constrained: set[Comparison] = field(default_factory=set)
    _constrained_at: tuple[int, int] | None = None

    def establish(self) -> None:
        """Exclude everything that could go wrong. Repeat while this makes terms equal or adds needs."""
        while True:
            known = (len(self.proof.equal.bindings), len(self.proof.needs))
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
            if known == (len(self.proof.equal.bindings), len(self.proof.needs)):
                return

    def _threats(self) -> Iterator[tuple[Pairs, Following, StepId]]:
        """Threats: steps that may come between the ends of a link, with a consequence that ends it."""
        denied = self._by_predicate(False)
        added = self._by_predicate(True)
        for need in self.proof.needs:
            threats = denied if need.positive else added
            for step, each in threats.get(need.atom.name, ()):
                if self._between(step, need):
                    yield [(each.atom, need.atom)], each, step

    def _taken_back(self) -> Iterator[tuple[Pairs, Following, StepId]]:
        """Additions of a step that could undo its own denials.

        A step may deny one atom and add another of the same predicate. Under some bindings they are the same
        atom. Then the atom is true after the step, although a later step needs it to be false.
        """
        for need in self.proof.needs:
            if not need.positive and need.producer != START:
                for added in self.proof.schemas[need.producer].adds:
                    if added.atom.name == need.atom.name:
                        yield [(added.atom, need.atom)], added, need.producer

    def _by_predicate(self, adds: bool) -> dict[str, list[tuple[StepId, Following]]]:
        found: dict[str, list[tuple[StepId, Following]]] = {}
        for step, schema in self.proof.schemas.items():
            for each in schema.adds if adds else schema.denies:
                found.setdefault(each.atom.name, []).append((step, each))
        return found

    def _between(self, step: StepId, need: SupportedLiteral) -> bool:
        if step in (need.producer, need.consumer):
            return False
        early = need.producer != START and step in self.proof.before[need.producer]
        late = need.consumer != GOAL and need.consumer in self.proof.before[step]
        return not early and not late

    def _contradictions(self) -> Iterator[tuple[Pairs, Following, StepId]]:
        for step, schema in self.proof.schemas.items():
            for denied in schema.denies:
                for added in schema.adds if denied.deduced else ():
                    if added.atom.name == denied.atom.name:
                        yield (*_apart(self.proof, denied, added), step)

    def _interference(self) -> Iterator[tuple[Pairs, Following, StepId]]:
        """Interference: unordered steps that share a resource, or where one denies what the other adds."""
        resources = {
            step: [substitute(r, self.proof.header(step)) for r in schema.operator.resources]
            for step, schema in self.proof.schemas.items()
        }
        for one, other in itertools.combinations(self.proof.schemas, 2):
            if one in self.proof.before[other] or other in self.proof.before[one]:
                continue
            for pair in itertools.product(resources[one], resources[other]):
                yield [pair], Following(Function("resource")), one
            for step, rival in ((one, other), (other, one)):
                yield from self._denials(step, rival)

    def _denials(self, step: StepId, rival: StepId) -> Iterator[tuple[Pairs, Following, StepId]]:
        for denied in self.proof.schemas[step].denies:
            for added in self.proof.schemas[rival].adds:
                if added.atom.name == denied.atom.name:
                    yield (*_apart(self.proof, denied, added), step)

    def _exclude(self, pairs: Pairs, cause: Following, step: StepId) -> None:
        """Demand a condition under which the pairs are never all equal while the guard of `cause` holds."""
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
        elif satisfiable(parts, self.proof.world.statics, self._values(parts)):
            raise NotGeneral(f"step {step} {cause.atom}: the original plan itself does not exclude this")
        else:
            self.exclusions[tuple(part for part in parts if part not in own) or parts] = None

    def excluded(self, parts: Body) -> bool:
        """Whether a condition that is already demanded prevents the parts from holding together."""
        equal = [part for part in parts if isinstance(part, Comparison) and part.relation == "="]
        return any(self._known_apart(part) for part in equal) or any(
            isinstance(part, Literal) and _negation(part) in self.negated for part in parts
        )

    def _known_apart(self, part: Comparison) -> bool:
        """Whether a disequality or a constraint says that the two terms of an equation differ."""
        differ = apart(part.left, part.right)
        if differ in self.disequalities:
            return True
        size = (len(self.proof.constraints), len(self.proof.equal.bindings))
        if self._constrained_at != size:
            demanded = map(self._resolved, filter(_is_apart, self.proof.constraints))
            self._constrained = {
                apart(each.left, each.right) for each in demanded if isinstance(each, Comparison)
            }
            self._constrained_at = size
        return differ in self._constrained

    def firing(self, pairs: Pairs, guard: Body) -> Body | None:
        """The condition that all pairs are equal and the guard holds, simplified; None if never true."""
        equal = self.proof.equal
        found = equations([(equal.resolved(one), equal.resolved(other)) for one, other in pairs])
        if found is None:
            return None
        origin = self.proof.origin
        local = {variable: term for variable, term in found.items() if variable not in origin}
        own = [Comparison(variable, "=", term) for variable, term in found.items() if variable in origin]
        resolved = [substitute_part(self._resolved(part), local) for part in guard]
        return simplified((*own, *resolved))

    def _resolved(self, part: BodyPart) -> BodyPart:
        return self.proof.equal.part(part, part_variables(part))

    def _values(self, parts: Body) -> dict[Variable, Term]:
        used = {variable for part in parts for variable in part_variables(part)}
        return {variable: self.proof.origin[variable] for variable in used if variable in self.proof.origin}

    def _true(self, part: BodyPart) -> bool:
        return satisfiable((part,), self.proof.world.statics, self._values((part,)))

    def _prevented(self, parts: Body, cause: Following, step: StepId) -> bool:
        """Whether a conditional effect does not happen because one of its conditions is false.

        The step then needs that.
        """
        if not satisfiable(parts, self.proof.world.statics, self._values(parts)):
            return False
        state = self.proof.states[step]
        for part in cause.needs:
            if not isinstance(part, Literal) or any(v not in self.proof.origin for v in part_variables(part)):
                continue
            if not satisfiable((part,), state, self._values((part,))):
                self.proof.need(part.atom, not part.positive, step)
                return True
        return False

    def _negate(self, false: list[BodyPart]) -> None:
        """Add the weakest negation of the parts.

        This is the first that is possible: terms differ, a comparison is negated, a static fact is negated,
        terms are equal.
        """
        equal = [part for part in false if isinstance(part, Comparison) and part.relation == "="]
        others = [part for part in false if isinstance(part, Comparison) and part.relation not in ("=", "!=")]
        literals = [part for part in false if isinstance(part, Literal)]
        if equal:
            self.disequalities[_differ(equal)] = None
        elif others or literals:
            self.negated[_negation((others or literals)[0])] = None
        else:
            part = false[0]
            assert isinstance(part, Comparison)
            self.proof.equal.join(part.left, part.right)


def _apart(proof: Proof, denied: Following, added: Following) -> tuple[Pairs, Following]:
    """A denial and an addition of the same atom, as one cause. The addition has its own local variables."""
    own = proof.apart(added)
    guard, needs = (*denied.guard, *own.guard), (*denied.needs, *own.needs)
    return [(denied.atom, own.atom)], Following(denied.atom, guard, needs)


def _negation(part: BodyPart) -> BodyPart:
    match part:
        case Comparison(left, "=", right):
            return apart(left, right)
        case Comparison(left, relation, right):
            return Comparison(left, NEGATED[relation], right)
        case Literal(atom, positive):
            return Literal(atom, not positive)
        case _:
            raise NotGeneral(f"{part} cannot be negated")


def _is_apart(part: BodyPart) -> bool:
    return isinstance(part, Comparison) and part.relation == "!="


def _differ(equal: list[Comparison]) -> Comparison:
    if len(equal) == 1:
        return apart(equal[0].left, equal[0].right)
    left, right = (Function("", tuple(getattr(each, side) for each in equal)) for side in ("left", "right"))
    return Comparison(left, "!=", right)
