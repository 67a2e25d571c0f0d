"""Extraction of a MACROP from a finished proof: variable names, types, constraints, links,
steps.
"""

import dataclasses
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from cellwright.engine.stages.lifted.domain_digests import proof_dependencies
from cellwright.engine.stages.macros.learning.plan_proof import PlanProof
from cellwright.engine.stages.macros.learning.proof_safety import ProofSafety
from cellwright.engine.stages.macros.learning.term_equalities import (
    comparison_truth,
    make_disequality,
)
from cellwright.kb.model.conditions import (
    Body,
    BodyPart,
    Comparison,
    Literal,
    Parameter,
    part_variables,
    substitute_part,
)
from cellwright.kb.model.domain_model import OBJECT_TYPE, Domain, Kind
from cellwright.kb.model.plan_model import (
    GOAL_STEP,
    INITIAL_STEP,
    CausalLink,
    MacroChain,
    Macrop,
    MacroStep,
    Step,
    StepId,
)
from cellwright.kb.terms import (
    Atom,
    Function,
    Number,
    Substitution,
    Term,
    Variable,
    substitute_term,
    term_variables,
)


class FreshNames:
    """New names for variables, given in order of first use."""

    def __init__(self) -> None:
        self.names: dict[Variable, Variable] = {}
        self._counts: dict[str, int] = {}

    def number(self, terms: Iterable[tuple[Variable, Term]]) -> None:
        """Name the terms of header variables, each after its first header variable: `Arm1`,
        `Id1`, `Id2`.
        """
        for header, term in terms:
            if isinstance(term, Variable) and term not in self.names:
                base = _base_name(header)
                self._counts[base] = self._counts.get(base, 0) + 1
                self.names[term] = Variable(f"{base}{self._counts[base]}")

    def keep(self, terms: Iterable[Term]) -> None:
        """Keep the names of the remaining variables; add a number if a name is already used."""
        for term in terms:
            for variable in term_variables(term):
                if variable not in self.names:
                    self.names[variable] = self._free(_base_name(variable))

    def _free(self, base: str) -> Variable:
        taken = {taken_variable.name for taken_variable in self.names.values()}
        name, number = base, 1
        while name in taken:
            number += 1
            name = f"{base}_{number}"
        return Variable(name)


def _base_name(variable: Variable) -> str:
    return variable.name.split("@")[0].rstrip("_") or "X"


def split_unary(parts: Iterable[BodyPart], domain: Domain) -> tuple[Body, tuple[Parameter, ...]]:
    """The n-ary constraints among the conjuncts, and the narrowest types of each variable."""
    rest: dict[BodyPart, None] = {}
    types: dict[Variable, list[str]] = {}
    for part in parts:
        if isinstance(part, Literal) and part.positive and _is_type(part, domain):
            for type_test in _type_tests(part.atom.arguments[0], part.atom.name, domain):
                if isinstance(type_test, Literal):
                    rest[type_test] = None
                else:
                    _narrow_types(types.setdefault(type_test.variable, []), type_test.type, domain)
        else:
            rest[part] = None
    return tuple(rest), tuple(Parameter(v, name) for v, names in types.items() for name in names)


def _is_type(part: Literal, domain: Domain) -> bool:
    return len(part.atom.arguments) == 1 and part.atom.name in domain.types


def _narrow_types(names: list[str], name: str, domain: Domain) -> None:
    if any(domain.is_subtype(narrower, name) for narrower in names):
        return
    names[:] = [*(old_name for old_name in names if not domain.is_subtype(name, old_name)), name]


def _type_tests(term: Term, type_: str, domain: Domain) -> Iterator[Parameter | Literal]:
    """The tests that remain for a term of a type.

    A compound term has the type if its arguments have theirs. A known object needs no test.
    """
    if isinstance(term, Variable):
        yield Parameter(term, type_)
        return
    if isinstance(term, Function) and not term.arguments and _is_known(term, type_, domain):
        return
    signature = (
        domain.functions.get(term.name) if isinstance(term, Function) and term.arguments else None
    )
    if (
        signature is None
        or not domain.is_subtype(signature.result, type_)
        or not isinstance(term, Function)
    ):
        yield Literal(Function(type_, (term,)))
        return
    for argument, inner in zip(term.arguments, signature.arguments, strict=True):
        if inner in domain.types and inner != OBJECT_TYPE:
            yield from _type_tests(argument, inner, domain)


def _is_known(term: Function, type_: str, domain: Domain) -> bool:
    own = domain.objects.get(term.name)
    if own is not None:
        return domain.is_subtype(own, type_)
    return any(
        term.name in declared_type.constants and domain.is_subtype(declared_type.name, type_)
        for declared_type in domain.types.values()
    )


def without_copies(body: Body, outer: set[Variable]) -> Body:
    """The body without copies of conjuncts that are equal except for the names of existential
    variables.

    Conjuncts that share such a variable belong together, so they are compared and removed together.
    """
    kept_parts: list[BodyPart] = []
    seen: set[str] = set()
    for group in _variable_groups(body, outer):
        names: dict[Variable, Term] = {}
        for part in group:
            for variable in part_variables(part):
                if variable not in outer:
                    names.setdefault(variable, Variable(f"_{len(names)}"))
        key = ", ".join(str(substitute_part(part, names)) for part in group)
        if key not in seen:
            seen.add(key)
            kept_parts += group
    return tuple(kept_parts)


def _variable_groups(body: Body, outer: set[Variable]) -> list[list[BodyPart]]:
    groups: list[tuple[set[Variable], list[BodyPart]]] = []
    for part in body:
        own = set(part_variables(part)) - outer
        joined = [group for group in groups if own & group[0]]
        parts = [member for group in joined for member in group[1]]
        groups = [group for group in groups if group not in joined]
        groups.append((own.union(*(group[0] for group in joined)), [*parts, part]))
    return [parts for _, parts in groups]


@dataclass(frozen=True, slots=True)
class GeneralisedPlan:
    """A MACROP, and the bindings that turn it back into the original plan."""

    macrop: Macrop
    bindings: dict[Variable, Term]


class MacroReader:
    """Reads a MACROP off a finished proof."""

    def __init__(
        self,
        proof: PlanProof,
        safety: ProofSafety,
        goals: tuple[Literal, ...],
        chains: tuple[MacroChain, ...],
    ) -> None:
        self.proof, self.safety, self.goals, self.chains = proof, safety, goals, chains
        self.names = FreshNames()
        for step in proof.plan.steps:
            header = proof.header(step.id)
            self.names.number((v, proof.equal.resolved(own)) for v, own in header.items())

    def result(self) -> GeneralisedPlan:
        proof, domain = self.proof, self.proof.world.domain
        preconditions = self._distinct(
            Literal(need.atom, need.positive)
            for need in proof.needs
            if need.producer == INITIAL_STEP
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
            _simple_disequalities(differ),
            tuple(
                dict.fromkeys(
                    tuple(map(self._part, exclusion)) for exclusion in self.safety.exclusions
                )
            ),
            tuple(dict.fromkeys(r for step in steps for r in step.resources)),
            steps,
            self._links(),
            chains,
        )
        depends = proof_dependencies(
            macrop, proof.schemas.values(), proof.world.digests, self._derived()
        )
        return GeneralisedPlan(dataclasses.replace(macrop, depends=depends), self._bindings())

    def _term(self, term: Term) -> Term:
        resolved = self.proof.equal.resolved(term)
        self.names.keep([resolved])
        return substitute_term(resolved, self.names.names)

    def _atom(self, atom: Atom) -> Atom:
        return Function(atom.name, tuple(map(self._term, atom.arguments)))

    def _part(self, part: BodyPart) -> BodyPart:
        return substitute_part(part, {v: self._term(v) for v in part_variables(part)})

    def _distinct(self, literals: Iterable[Literal]) -> tuple[Literal, ...]:
        return tuple(
            dict.fromkeys(
                Literal(self._atom(literal.atom), literal.positive) for literal in literals
            )
        )

    def _chain(self, chain: MacroChain) -> MacroChain:
        subject = self._term(chain.subject) if chain.subject is not None else None
        stages = tuple(map(self._atom, chain.stages))
        return MacroChain(
            self._term(chain.name), stages, tuple(map(self._term, chain.after)), subject
        )

    def _step(self, step: Step) -> MacroStep:
        operator = self.proof.schemas[step.id].operator
        bindings = {v: self._term(own) for v, own in self.proof.header(step.id).items()}
        header = Function(operator.name, tuple(bindings.values()))
        resources = tuple(substitute_term(resource, bindings) for resource in operator.resources)
        duration = _step_amount(operator.duration, bindings, step.duration)
        return MacroStep(
            step.id,
            header,
            step.after,
            resources,
            duration,
            _step_amount(operator.cost, bindings, step.cost),
        )

    def _constraints(self) -> tuple[Body, tuple[Parameter, ...]]:
        constraints, types = split_unary(
            map(self._part, self.proof.constraints), self.proof.world.domain
        )
        return without_copies(constraints, set(self._header_variables())), types

    def _header_variables(self) -> Iterator[Variable]:
        for step in self.proof.plan.steps:
            for own in self.proof.header(step.id).values():
                yield from term_variables(self._term(own))
        for atom in [
            *(goal.atom for goal in self.goals),
            *(need.atom for need in self.proof.needs),
        ]:
            yield from term_variables(self._atom(atom))

    def _links(self) -> tuple[CausalLink, ...]:
        links: dict[CausalLink, None] = {}
        for need in self.proof.needs:
            atom = self._atom(need.atom)
            condition = atom if need.positive else Function("not", (atom,))
            links[CausalLink(need.producer, condition, need.consumer)] = None
        for link in self.proof.plan.links:
            if is_stage_link(link.condition):
                links[CausalLink(link.producer, self._stage(link.condition), link.consumer)] = None
        order: dict[StepId, int] = {
            step.id: place for place, step in enumerate(self.proof.plan.steps)
        }
        return tuple(
            sorted(links, key=lambda link_entry: order.get(link_entry.consumer, len(order)))
        )

    def _stage(self, condition: Atom) -> Atom:
        """A counter of a chain, in which the name of the chain is replaced by the chain's
        variable.
        """
        names = {
            self.proof.origin[chain.name]: chain.name
            for chain in self.chains
            if isinstance(chain.name, Variable)
        }
        arguments = tuple(
            self._stage(argument)
            if isinstance(argument, Function) and argument.arguments
            else self._term(names.get(argument, argument))
            for argument in condition.arguments
        )
        return Function(condition.name, arguments)

    def _adders(self) -> tuple[Atom, ...]:
        """The atoms that hold at the end of every instance: surely added, and not denied by a
        later step.
        """
        proof, added_atoms = self.proof, dict[Atom, None]()
        for step, schema in proof.schemas.items():
            for addition in schema.adds:
                certain = self.safety.firing([], addition.guard)
                local = any(v not in proof.origin for v in term_variables(addition.atom))
                if (
                    certain == ()
                    and not addition.needs
                    and not local
                    and self._lasts(step, addition.atom)
                ):
                    added_atoms[self._atom(addition.atom)] = None
        goal_atoms = [
            need.atom for need in proof.needs if need.consumer == GOAL_STEP and need.positive
        ]
        return tuple(dict.fromkeys([*added_atoms, *map(self._atom, goal_atoms)]))

    def _lasts(self, producer: StepId, atom: Atom) -> bool:
        for step, schema in self.proof.schemas.items():
            if step == producer or step in self.proof.before[producer]:
                continue
            for denial in schema.denies:
                parts = (
                    self.safety.firing([(denial.atom, atom)], denial.guard)
                    if denial.atom.name == atom.name
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
            literals += [
                part for body in schema.alternatives for part in body if isinstance(part, Literal)
            ]
        wanted_names = [literal.atom.name for literal in literals]
        reached: set[str] = set()
        while wanted_names:
            name = wanted_names.pop()
            if (
                name in used
                and name not in reached
                and kinds.get(name, Kind.DERIVED) is Kind.DERIVED
            ):
                reached.add(name)
                bodies = (r.body for r in self.proof.world.domain.rules if r.head.name == name)
                wanted_names += [
                    part.atom.name for body in bodies for part in body if isinstance(part, Literal)
                ]
        return tuple(sorted(reached))

    def _name(
        self,
        goals: tuple[Literal, ...],
        chains: tuple[MacroChain, ...],
        steps: tuple[MacroStep, ...],
    ) -> Function:
        asked = [goal.atom for goal in goals] + [
            stage for chain in chains for stage in chain.stages
        ]
        last = list(dict.fromkeys(v for atom in asked for v in term_variables(atom)))
        first = dict.fromkeys(v for step in steps for v in term_variables(step.operator))
        own = [*(v for v in first if v not in last), *last]
        return Function(asked[0].name if asked else steps[-1].operator.name, tuple(own))

    def _bindings(self) -> dict[Variable, Term]:
        origin = self.proof.origin
        bindings: dict[Variable, Term] = {}
        for variable, name in self.names.names.items():
            if variable in origin:
                bindings[name] = origin[variable]
        return bindings


def is_stage_link(condition: Atom) -> bool:
    """Whether a link's condition is a counter of a workflow chain."""
    inner = condition.arguments[0] if condition.name == "not" and condition.arguments else condition
    return isinstance(inner, Function) and inner.name == "_stage"


def _simple_disequalities(parts: Iterable[BodyPart]) -> tuple[Comparison, ...]:
    disequalities = (
        make_disequality(part.left, part.right) for part in parts if isinstance(part, Comparison)
    )
    return tuple(
        dict.fromkeys(
            comparison for comparison in disequalities if comparison_truth(comparison) is not True
        )
    )


def _is_apart(part: BodyPart) -> bool:
    return isinstance(part, Comparison) and part.relation == "!="


def _step_amount(term: Term | None, bindings: Substitution, plan_amount: int) -> Term:
    """A duration or cost: that of the operator; if it has none, that of the plan."""
    return Number(plan_amount) if term is None else substitute_term(term, bindings)
