"""Reads a MACROP off a finished proof: resolves terms, names variables, separates constraints by arity."""

import dataclasses
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from cellwright.engine.stages.macros.learning.naming import FreshNames
from cellwright.engine.stages.macros.learning.proof import Proof
from cellwright.engine.stages.macros.learning.safety import Safety
from cellwright.engine.stages.macros.learning.terms import apart, decided
from cellwright.engine.stages.macros.learning.types import unary, without_copies
from cellwright.engine.stages.macros.lifted.digests import dependencies
from cellwright.kb.model.conditions import (
    Body,
    BodyPart,
    Comparison,
    Literal,
    Parameter,
    part_variables,
    substitute_part,
)
from cellwright.kb.model.domain import Kind
from cellwright.kb.model.macro import MacroChain, Macrop, MacroStep
from cellwright.kb.model.plan import GOAL, START, CausalLink, Step, StepId
from cellwright.kb.terms import Atom, Function, Number, Substitution, Term, Variable, substitute, variables


@dataclass(frozen=True, slots=True)
class Generalised:
    """A MACROP, and the bindings that turn it back into the original plan."""

    macrop: Macrop
    bindings: dict[Variable, Term]


class Reading:
    """Reads a MACROP off a finished proof."""

    def __init__(
        self, proof: Proof, safety: Safety, goals: tuple[Literal, ...], chains: tuple[MacroChain, ...]
    ) -> None:
        self.proof, self.safety, self.goals, self.chains = proof, safety, goals, chains
        self.names = FreshNames()
        for step in proof.plan.steps:
            header = proof.header(step.id)
            self.names.number((v, proof.equal.resolved(own)) for v, own in header.items())

    def result(self) -> Generalised:
        proof, domain = self.proof, self.proof.world.domain
        preconditions = self._distinct(
            Literal(need.atom, need.positive) for need in proof.needs if need.producer == START
        )
        goals = self._distinct(self.goals)
        chains = tuple(map(self._chain, self.chains))
        constraints, types = self._constraints()
        steps = tuple(map(self._step, proof.plan.steps))
        differ = [*map(self._part, self.safety.disequalities), *filter(_is_apart, constraints)]
        constraints = tuple(part for part in constraints if not _is_apart(part))
        macrop = Macrop(
            self._name(goals, chains, steps),
            domain.name,
            goals,
            preconditions,
            self._adders(),
            types,
            tuple(dict.fromkeys((*constraints, *map(self._part, self.safety.negated)))),
            _disequalities(differ),
            tuple(dict.fromkeys(tuple(map(self._part, each)) for each in self.safety.exclusions)),
            tuple(dict.fromkeys(r for step in steps for r in step.resources)),
            steps,
            self._links(),
            chains,
        )
        depends = dependencies(macrop, proof.schemas.values(), proof.world.digests, self._derived())
        return Generalised(dataclasses.replace(macrop, depends=depends), self._bindings())

    def _term(self, term: Term) -> Term:
        resolved = self.proof.equal.resolved(term)
        self.names.keep([resolved])
        return substitute(resolved, self.names.names)

    def _atom(self, atom: Atom) -> Atom:
        return Function(atom.name, tuple(map(self._term, atom.arguments)))

    def _part(self, part: BodyPart) -> BodyPart:
        return substitute_part(part, {v: self._term(v) for v in part_variables(part)})

    def _distinct(self, literals: Iterable[Literal]) -> tuple[Literal, ...]:
        return tuple(dict.fromkeys(Literal(self._atom(each.atom), each.positive) for each in literals))

    def _chain(self, chain: MacroChain) -> MacroChain:
        subject = self._term(chain.subject) if chain.subject is not None else None
        stages = tuple(map(self._atom, chain.stages))
        return MacroChain(self._term(chain.name), stages, tuple(map(self._term, chain.after)), subject)

    def _step(self, step: Step) -> MacroStep:
        operator = self.proof.schemas[step.id].operator
        bindings = {v: self._term(own) for v, own in self.proof.header(step.id).items()}
        header = Function(operator.name, tuple(bindings.values()))
        resources = tuple(substitute(each, bindings) for each in operator.resources)
        duration = _amount(operator.duration, bindings, step.duration)
        return MacroStep(
            step.id, header, step.after, resources, duration, _amount(operator.cost, bindings, step.cost)
        )

    def _constraints(self) -> tuple[Body, tuple[Parameter, ...]]:
        kept, types = unary(map(self._part, self.proof.constraints), self.proof.world.domain)
        return without_copies(kept, set(self._header_variables())), types

    def _header_variables(self) -> Iterator[Variable]:
        for step in self.proof.plan.steps:
            for own in self.proof.header(step.id).values():
                yield from variables(self._term(own))
        for atom in [*(each.atom for each in self.goals), *(need.atom for need in self.proof.needs)]:
            yield from variables(self._atom(atom))

    def _links(self) -> tuple[CausalLink, ...]:
        found: dict[CausalLink, None] = {}
        for need in self.proof.needs:
            atom = self._atom(need.atom)
            condition = atom if need.positive else Function("not", (atom,))
            found[CausalLink(need.producer, condition, need.consumer)] = None
        for link in self.proof.plan.links:
            if is_stage(link.condition):
                found[CausalLink(link.producer, self._stage(link.condition), link.consumer)] = None
        order: dict[StepId, int] = {step.id: place for place, step in enumerate(self.proof.plan.steps)}
        return tuple(sorted(found, key=lambda each: order.get(each.consumer, len(order))))

    def _stage(self, condition: Atom) -> Atom:
        """A counter of a chain, in which the name of the chain is replaced by the chain's variable."""
        names = {
            self.proof.origin[each.name]: each.name for each in self.chains if isinstance(each.name, Variable)
        }
        arguments = tuple(
            self._stage(each)
            if isinstance(each, Function) and each.arguments
            else self._term(names.get(each, each))
            for each in condition.arguments
        )
        return Function(condition.name, arguments)

    def _adders(self) -> tuple[Atom, ...]:
        """The atoms that hold at the end of every instance: surely added, and not denied by a later step."""
        proof, found = self.proof, dict[Atom, None]()
        for step, schema in proof.schemas.items():
            for each in schema.adds:
                certain = self.safety.firing([], each.guard)
                local = any(v not in proof.origin for v in variables(each.atom))
                if certain == () and not each.needs and not local and self._lasts(step, each.atom):
                    found[self._atom(each.atom)] = None
        known = [need.atom for need in proof.needs if need.consumer == GOAL and need.positive]
        return tuple(dict.fromkeys([*found, *map(self._atom, known)]))

    def _lasts(self, producer: StepId, atom: Atom) -> bool:
        for step, schema in self.proof.schemas.items():
            if step == producer or step in self.proof.before[producer]:
                continue
            for each in schema.denies:
                parts = (
                    self.safety.firing([(each.atom, atom)], each.guard)
                    if each.atom.name == atom.name
                    else None
                )
                if parts is not None and not self.safety.excluded(parts):
                    return False
        return True

    def _derived(self) -> tuple[str, ...]:
        kinds = self.proof.world.schemas.kinds
        literals: list[Literal] = list(self.goals)
        used = {r.head.name for r in self.proof.world.domain.rules}
        for schema in self.proof.schemas.values():
            literals += [part for body in schema.alternatives for part in body if isinstance(part, Literal)]
        wanted = [each.atom.name for each in literals]
        reached: set[str] = set()
        while wanted:
            name = wanted.pop()
            if name in used and name not in reached and kinds.get(name, Kind.DERIVED) is Kind.DERIVED:
                reached.add(name)
                bodies = (r.body for r in self.proof.world.domain.rules if r.head.name == name)
                wanted += [part.atom.name for body in bodies for part in body if isinstance(part, Literal)]
        return tuple(sorted(reached))

    def _name(
        self, goals: tuple[Literal, ...], chains: tuple[MacroChain, ...], steps: tuple[MacroStep, ...]
    ) -> Function:
        asked = [each.atom for each in goals] + [stage for chain in chains for stage in chain.stages]
        last = list(dict.fromkeys(v for atom in asked for v in variables(atom)))
        first = dict.fromkeys(v for step in steps for v in variables(step.operator))
        own = [*(v for v in first if v not in last), *last]
        return Function(asked[0].name if asked else steps[-1].operator.name, tuple(own))

    def _bindings(self) -> dict[Variable, Term]:
        origin = self.proof.origin
        found: dict[Variable, Term] = {}
        for variable, name in self.names.names.items():
            if variable in origin:
                found[name] = origin[variable]
        return found


def is_stage(condition: Atom) -> bool:
    """Whether a link's condition is a counter of a workflow chain."""
    inner = condition.arguments[0] if condition.name == "not" and condition.arguments else condition
    return isinstance(inner, Function) and inner.name == "_stage"


def _disequalities(parts: Iterable[BodyPart]) -> tuple[Comparison, ...]:
    found = (apart(part.left, part.right) for part in parts if isinstance(part, Comparison))
    return tuple(dict.fromkeys(each for each in found if decided(each) is not True))


def _is_apart(part: BodyPart) -> bool:
    return isinstance(part, Comparison) and part.relation == "!="


def _amount(term: Term | None, bindings: Substitution, given: int) -> Term:
    """A duration or cost: that of the operator; if it has none, that of the plan."""
    return Number(given) if term is None else substitute(term, bindings)
