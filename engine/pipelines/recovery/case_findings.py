"""Findings of a case: which facts are withdrawn, asserted, kept or lost, and what not to retry."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

from cellwright.engine.model.noun_wording import name_with_meaning
from cellwright.engine.model.troubleshooting import CaseDiagnosis, Revision
from cellwright.engine.pipelines.recovery import WorldState
from cellwright.engine.pipelines.recovery.case_beliefs import NO_CAUSES, CaseBeliefs, Causes
from cellwright.engine.pipelines.recovery.replanning import RepairFirst
from cellwright.engine.pipelines.recovery.world_model import is_instance
from cellwright.engine.stages.diagnosis.case_session import CaseSession
from cellwright.engine.stages.diagnosis.fault_problems import cure_chance
from cellwright.kb.model.domain_model import Kind
from cellwright.kb.terms import Atom, sort_naturally

Reasoned = tuple[tuple[Atom, str], ...]


@dataclass(frozen=True)
class CaseFindings:
    """A diagnosis, held against the states that were believed while it was made."""

    beliefs: CaseBeliefs
    made: CaseDiagnosis

    @property
    def causes(self) -> Causes:
        """The causes that were found; none if several sets are possible."""
        return (
            self.made.hypotheses[0][0].causes
            if self.made.isolated and self.made.hypotheses
            else NO_CAUSES
        )

    @property
    def believed(self) -> WorldState:
        """The state now: what is sure under every hypothesis that is counted on."""
        return self.beliefs.common(self.made.counted_on)

    @property
    def suspects(self) -> tuple[str, ...]:
        """The causes that are or may be there still."""
        if self.made.cured:
            return ()
        return tuple(dict.fromkeys(cause for h in self.made.counted_on for cause in h.causes))

    def applied(self, said: Revision) -> Revision:
        """What a revision comes to in this world: what holds now and did not, and the other way
        round.

        What it says of facts that never held, or that a repair has made as they were, is left out.
        """
        begun = self.beliefs.cell.begun(self.beliefs.before, self.causes)
        before, now = self.beliefs.before.facts, self.believed.facts
        gone, new = before - begun.facts, begun.facts - before
        if self.beliefs.helped is not None:
            last = replace(self.beliefs, helped=None).state(self.causes)
            gone, new = gone | (last.facts - now), new | (now - last.facts)
        gone, new = (gone & before) - now, (new & now) - before
        withdrawn = (*_facts_named(said.withdrawn, gone), *self._spoilt(gone), *self._unsure(now))
        asserted = _facts_named(said.asserted, new)
        named_atoms = {atom for atom, _ in (*withdrawn, *asserted)}
        return replace(
            said,
            withdrawn=withdrawn,
            asserted=asserted,
            restored=tuple((atom, why) for atom, why in said.restored if atom in now),
            lost=self._lost(),
            regained=self._regained(),
            blocked=self._blocked(),
            kept=tuple(self._kept(before)),
            follows=tuple(_facts_following(gone, new, named_atoms)),
        )

    def _spoilt(self, gone: frozenset[Atom]) -> Reasoned:
        model, cell = self.beliefs.cell.model, self.beliefs.cell
        return tuple(
            (
                atom,
                f"{name_with_meaning(cause, model.causes[cause].say)}; step {work.id} made it "
                "before that was noticed",
            )
            for cause in self.causes
            for work in cell.spoilt(cause)[0]
            for atom in work.added
            if atom in gone or self._is_event(atom)
        )

    def _is_event(self, atom: Atom) -> bool:
        return self.beliefs.cell.dynamics.problem.domain.predicates[atom.name].kind is Kind.EVENT

    def _kept(self, before: frozenset[Atom]) -> Iterator[tuple[Atom, str]]:
        """Work like the work that a cause puts in doubt."""
        cell = self.beliefs.cell
        for cause in self.causes:
            spoilt, standing = cell.spoilt(cause)
            gone = {atom for work in spoilt for atom in work.added}
            named_atoms = {
                atom: f"step {work.id} made it before {cause} was last ruled out"
                for work in standing
                for atom in work.added
            }
            patterns = cell.patterns(cause)
            for atom in sort_naturally(before - gone):
                if any(is_instance(pattern, atom) for pattern in patterns):
                    yield atom, named_atoms.get(atom, "it was so when the plan began")

    def _unsure(self, now: frozenset[Atom]) -> Reasoned:
        """The facts that hold only under some of the hypotheses that are left."""
        if self.made.isolated:
            return ()
        unsure: dict[Atom, str] = {}
        for hypothesis, _ in self.made.hypotheses:
            state = self.beliefs.state(hypothesis.causes)
            for believed in self.beliefs.state(NO_CAUSES).facts - state.facts:
                unsure.setdefault(
                    believed, f"not sure: it does not hold if the cause is {hypothesis}"
                )
        return tuple((atom, unsure[atom]) for atom in sort_naturally(set(unsure) - now))

    def _lost(self) -> tuple[str, ...]:
        cell = self.beliefs.cell
        names = [str(term) for cause in self.suspects for term in cell.lost(cause)]
        if self.beliefs.helped is not None:
            names += [str(term) for term in cell.given_up(self.beliefs.helped)]
        return tuple(dict.fromkeys(names))

    def _regained(self) -> tuple[str, ...]:
        """What is lost with the causes that are gone, and that the repair does not go on
        without.
        """
        if self.made.cured is None:
            return ()
        names = [
            str(t)
            for h in self.made.counted_on
            for cause in h.causes
            for t in self.beliefs.cell.lost(cause)
        ]
        return tuple(each for each in dict.fromkeys(names) if each not in self._lost())

    def _blocked(self) -> Reasoned:
        cell = self.beliefs.cell
        return tuple(
            (pattern, self._still_there(cause))
            for cause in self.suspects
            for pattern in dict.fromkeys(cell.blocked(cause))
        )

    def _still_there(self, cause: str) -> str:
        """That a cause is there still, and what would put it right: a repair that was not tried
        in vain.
        """
        model = self.beliefs.cell.model
        certain = len(self.made.counted_on) <= 1
        reasons = (
            name_with_meaning(f"{cause} is there still", model.causes[cause].say)
            if certain
            else f"{cause} may be there still"
        )
        repair = next(
            (cure for cure in self.made.repairs if cause in model.repairs[cure].cures), None
        )
        return (
            f"{reasons}; {repair} may put it right"
            if repair
            else f"{reasons}; nobody has put it right"
        )


def first_repair(
    beliefs: CaseBeliefs, session: CaseSession, made: CaseDiagnosis
) -> tuple[RepairFirst, CaseBeliefs, CaseDiagnosis] | None:
    """The repair with which a recovery begins, what is believed after it, and the case as it stands
    then.

    None where the trouble is gone, where the cause is not known or hinders nothing, and where no
    repair is sure to help without anybody's help.
    """
    model, findings = beliefs.cell.model, CaseFindings(beliefs, made)
    hindered = any(
        beliefs.cell.blocked(cause) or beliefs.cell.lost(cause) for cause in findings.suspects
    )
    if not made.isolated or not hindered:
        return None
    for name in made.repairs:
        repair = model.repairs[name]
        sure = all(cure_chance(repair, hypothesis) == 1.0 for hypothesis in made.counted_on)
        later = beliefs.repaired(session, name) if sure and not repair.asks else None
        if later is not None:
            after, prepared = later
            return RepairFirst(name, repair.say, prepared), after, replace(made, cured=name)
    return None


def _facts_named(reasoned: Reasoned, changed: frozenset[Atom]) -> Reasoned:
    """The facts among those that changed which fit what is said."""
    reason_of = {
        atom: why
        for pattern, why in reasoned
        for atom in sort_naturally(a for a in changed if is_instance(pattern, a))
    }
    return tuple(reason_of.items())


def _facts_following(
    gone: frozenset[Atom], new: frozenset[Atom], named_atoms: set[Atom]
) -> Iterator[tuple[Atom, bool]]:
    yield from ((atom, True) for atom in sort_naturally(new - named_atoms))
    yield from ((atom, False) for atom in sort_naturally(gone - named_atoms))
