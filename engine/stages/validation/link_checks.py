"""Causal links that a plan claims: whether each holds in every order, and whether it serves."""

from bisect import bisect_left
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

from cellwright.engine.stages.validation.chain_progress import ChainProgress
from cellwright.engine.stages.validation.checker_facts import CheckerFacts
from cellwright.engine.stages.validation.step_changes import Denial
from cellwright.engine.stages.validation.step_interference import (
    ExecutedStep,
    StepInterference,
    counts_stages,
    split_negation,
)
from cellwright.kb.model.domain_model import Kind
from cellwright.kb.model.plan_model import GOAL_STEP, INITIAL_STEP, CausalLink, StepId
from cellwright.kb.model.planning_problem import Chain, reaches_stage
from cellwright.kb.terms import Atom, Function, Number, Term, Text, Variable, is_ground, stage_parts
from cellwright.kb.terms import match_term as matched

Region = tuple[str, Term | None]


@dataclass
class CausalLinks:
    """The links of an executed plan, whose steps have moved the chains of its workflow."""

    plan: StepInterference
    stages: ChainProgress

    def broken(self) -> Iterator[str]:
        """What is wrong with each link that does not hold; stages are followed by themselves."""
        for link in self.plan.plan.links:
            if not counts_stages(link.condition) and (wrong := self._broken(link)):
                yield f"{_link_text(link)}: {wrong}"

    def idle(self) -> Iterator[str]:
        """The links for a condition that their consumer does not depend on, and those for
        stages that are none.
        """
        linked = CheckerFacts(
            split_negation(link.condition)[0]
            for link in self.plan.plan.links
            if link.consumer == GOAL_STEP
        )
        needs = {GOAL_STEP: _atoms_among(linked, self._needs_of_goals())}
        for link in self.plan.plan.links:
            user = link.consumer
            if counts_stages(link.condition):
                if wrong := self._stage(link):
                    yield f"{_link_text(link)}: {wrong}"
                continue
            if user not in needs:
                needs[user] = self._needs(self.plan.executed[user])
            atom, _ = split_negation(link.condition)
            if atom not in needs[user] and all(
                matched(need, atom, {}) is None for need in needs[user]
            ):
                yield f"{_link_text(link)}: the consumer does not need it"

    def lasts_until(self, atom: Atom, step: StepId) -> bool:
        """Whether an atom, a stage of the workflow, holds in every order when a step has come."""
        adders = [self.plan.order.ids[place] for place in self._adding.get(atom, ())]
        return any(
            not self._broken(CausalLink(adder, atom, step))
            for adder in (INITIAL_STEP, *adders)
            if adder != step
        )

    def _broken(self, link: CausalLink) -> str:
        """Why a link does not hold in every order; nothing if it does."""
        atom, positive = split_negation(link.condition)
        if self._unordered(link):
            return "the producer is not ordered before the consumer"
        if not self._produces(link.producer, atom, positive):
            return "the producer does not achieve it"
        for executed in self._meddling(link, atom, positive):
            if self._destroys(executed, atom, positive):
                return (
                    f"step {executed.step.id} {executed.step.operator} can come between and end it"
                )
        return ""

    def _unordered(self, link: CausalLink) -> bool:
        between_steps = link.producer != INITIAL_STEP and link.consumer != GOAL_STEP
        return between_steps and not self.plan.order.precedes(link.producer, link.consumer)

    def _stage(self, link: CausalLink) -> str:
        """Why a link for the number of stages of a chain is wrong; the order of stages is
        checked for itself.
        """
        match link.condition:
            case Function(_, (Text(name), Number(reached))):
                chain = next(
                    (
                        problem_chain
                        for problem_chain in self.plan.problem.chains
                        if problem_chain.name == name
                    ),
                    None,
                )
            case _:
                chain, reached = None, 0
        if chain is None or not 0 <= reached <= len(chain.stages):
            return "there is no such stage"
        if self._unordered(link):
            return "the producer is not ordered before the consumer"
        return (
            "" if self._reached(link.producer, chain, reached) else "the producer does not reach it"
        )

    def _reached(self, producer: StepId, chain: Chain, reached: int) -> bool:
        """Whether a chain has so many stages because of a step, or from the start on."""
        if reached == 0:
            return producer == INITIAL_STEP
        if self.stages.steps_of(chain.name)[reached - 1 :][:1] == (producer,):
            return True
        return producer != INITIAL_STEP and self._reaches(producer, chain.stages[reached - 1])

    def _reaches(self, producer: StepId, stage: Atom) -> bool:
        change = self.plan.executed[producer].change
        done = (*change.adds, *change.events)
        return any(reaches_stage(atom, part) for atom in done for part in stage_parts(stage))

    def _meddling(self, link: CausalLink, atom: Atom, positive: bool) -> Iterator[ExecutedStep]:
        """The steps that may end the condition of a link and may come while it lasts, in their
        order.
        """
        first, last = self.plan.order.between(link.producer, link.consumer)
        single, any_of = self._denying
        begins = {None, *atom.arguments[:1]}
        lists = (
            single.get(atom, ()),
            *(any_of.get((atom.name, own_places), ()) for own_places in begins),
        )
        places = lists if positive else (self._adding.get(atom, ()),)
        meddling = {
            p
            for each in places
            if each
            for p in each[bisect_left(each, first) : bisect_left(each, last)]
        }
        ends = self._ends(link)
        meddling.difference_update(ends)
        return (
            self._executed[place] for place in sorted(meddling) if self._comes_between(place, *ends)
        )

    def _ends(self, link: CausalLink) -> tuple[int, int]:
        """The places of a link's producer and consumer; the start is before all places, the
        goal after them.
        """
        place = self.plan.order.place
        last = len(place) if link.consumer == GOAL_STEP else place[link.consumer]
        return -1 if link.producer == INITIAL_STEP else place[link.producer], last

    def _comes_between(self, place: int, first: int, last: int) -> bool:
        """Whether a step may come after the one at `first` and before the one at `last`.

        It waits only for steps at lower places.
        """
        before = self.plan.order.before
        return not (place < first and before(place, first)) and not (
            place > last and before(last, place)
        )

    @cached_property
    def _executed(self) -> list[ExecutedStep]:
        return list(self.plan.executed.values())

    @cached_property
    def _adding(self) -> dict[Atom, list[int]]:
        """For each atom the places of the steps that add it."""
        places_by_atom: dict[Atom, list[int]] = {}
        for place, executed in enumerate(self._executed):
            for atom in executed.change.adds:
                places_by_atom.setdefault(atom, []).append(place)
        return places_by_atom

    @cached_property
    def _denying(self) -> tuple[dict[Atom, list[int]], dict[Region, list[int]]]:
        """For each atom the places of the steps that deny just it; for each predicate those that
        may deny its atoms.

        The latter are apart by the first argument of what they deny, and under None if it may be
        any.
        """
        single: dict[Atom, list[int]] = {}
        any_of: dict[Region, list[int]] = {}
        for place, executed in enumerate(self._executed):
            for pattern in {
                denial.pattern for denial in executed.change.denials if denial.consequence is None
            }:
                single.setdefault(pattern, []).append(place)
            for region in {
                _region_of(denial)
                for denial in executed.change.denials
                if denial.consequence is not None
            }:
                any_of.setdefault(region, []).append(place)
        return single, any_of

    def _produces(self, producer: StepId, atom: Atom, positive: bool) -> bool:
        if producer == INITIAL_STEP:
            return (atom in self.plan.start) == positive
        change = self.plan.executed[producer].change
        if positive:
            return atom in change.adds
        statics = self.plan.semantics.statics
        return atom not in change.adds and any(d.matches(atom, statics) for d in change.denials)

    def _destroys(self, executed: ExecutedStep, atom: Atom, positive: bool) -> bool:
        if not positive:
            return atom in executed.change.adds
        return atom not in executed.change.adds and executed.denies(
            atom, self.plan.semantics.statics
        )

    def _needs(self, executed: ExecutedStep) -> set[Atom]:
        """What a step depends on, as atoms or patterns: its conditions, what it ends with
        consequences, and the stages that are reached with it because they hold already, or that it
        makes true in their turn.
        """
        conditions = [
            executed.operator.precondition,
            *(e.condition for e in executed.operator.effects),
        ]
        atoms = {
            atom
            for condition in conditions
            for atom in self.plan.mentioned(condition, executed.bindings)
        }
        held_stages = {
            atom for atom, steps in self._stages_held.items() if executed.step.id in steps
        }
        parts = {part for stage in self.stages.late for part in stage_parts(stage)}
        late = {
            part
            for part in parts
            if any(reaches_stage(atom, part) for atom in executed.change.adds)
        }
        return atoms | executed.change.triggered | held_stages | late

    @cached_property
    def _stages_held(self) -> dict[Atom, set[StepId]]:
        """The atoms that held when they reached a stage, and the steps with which they did."""
        steps_by_stage: dict[Atom, set[StepId]] = {}
        for own in self.stages.trail():
            for reached_stage in own:
                for atom in reached_stage.held:
                    steps_by_stage.setdefault(atom, set()).add(reached_stage.step)
        return steps_by_stage

    def _needs_of_goals(self) -> set[Atom]:
        """What the goals mention, and the fluents that are stages, the last of which must stay."""
        problem = self.plan.problem
        fluents = {
            name
            for name, predicate in problem.domain.predicates.items()
            if predicate.kind is Kind.FLUENT
        }
        stages = {
            part
            for chain in problem.chains
            for stage in chain.stages
            for part in stage_parts(stage)
        }
        stages = {stage for stage in stages if stage.name in fluents}
        return {*self.plan.mentioned(problem.goal, {}), *stages}


def _region_of(denial: Denial) -> Region:
    """The predicate of what is denied, and its first argument if that is certain."""
    if not denial.pattern.arguments:
        return denial.pattern.name, None
    first = denial.pattern.arguments[0]
    known = dict(denial.bindings).get(first, first) if isinstance(first, Variable) else first
    return denial.pattern.name, known if is_ground(known) else None


def _atoms_among(atoms: CheckerFacts, patterns: set[Atom]) -> set[Atom]:
    """The atoms that match one of the patterns."""
    return {
        atom
        for pattern in patterns
        for atom in atoms.matching(pattern)
        if matched(pattern, atom, {}) is not None
    }


def _link_text(link: CausalLink) -> str:
    return f"link {link.producer} to {link.consumer} for {link.condition}"
