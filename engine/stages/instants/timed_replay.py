"""Carries out a plan with times, one instant after another, and collects what is wrong."""

import itertools
from collections.abc import Iterator
from fractions import Fraction

from cellwright.engine.stages.instants.acts import ADDITIVE, Act, Instant, instant_of, timed_instant
from cellwright.engine.stages.instants.breaches import Breach, decimal
from cellwright.engine.stages.instants.condition_values import Moments, NoValue
from cellwright.kb.model.durative import Moment, TemporalProblem, TimedChange, TimedPlan, TimedStep
from cellwright.kb.terms import Atom, Function

TOLERANCE = Fraction(1, 10**6)  # what the decimals of a plan may round away of a duration


class Replay:
    """Carries a plan out and collects what is wrong."""

    def __init__(self, problem: TemporalProblem, plan: TimedPlan) -> None:
        self.problem = problem
        self.actions = {action.name: action for action in problem.actions}
        self.found: list[Breach] = []
        self.moments = Moments(problem, problem.initial, dict(problem.values))
        self.acts = [
            act for number, step in enumerate(plan.steps, 1) if (act := self._act(number, step))
        ]
        self.instants: list[Instant] = []

    def breaches(self) -> list[Breach]:
        """Everything that is wrong, in the order of time."""
        for time in self._times():
            self._happen(time)
        self._separation()
        end = max([Fraction(0), *(act.step.end for act in self.acts)])
        broken = self.moments.broken(self.problem.goal, {}, Fraction(0))
        if broken is not None:
            self._add(
                "K502", end, 0, f"the goal {broken.said} does not hold at the end", broken.amount
            )
        return sorted(self.found, key=lambda breach: (breach.time, breach.step))

    def _add(
        self, code: str, time: Fraction, step: int, said: str, amount: Fraction | None = None
    ) -> None:
        self.found.append(Breach(code, time, step, said, amount))

    def _act(self, number: int, step: TimedStep) -> Act | None:
        """A step with its action; None, and a breach, for a step that no action has."""
        action = self.actions.get(step.action.name)
        said = f"step {number} {step.action}"
        if action is None or len(action.parameters) != len(step.action.arguments):
            self._add("K501", step.start, number, f"{said}: there is no such action")
            return None
        for parameter, argument in zip(action.parameters, step.action.arguments, strict=True):
            types = self.problem.objects.get(str(argument))
            if types is None or parameter.type not in types:
                self._add("K501", step.start, number, f"{said}: {argument} is no {parameter.type}")
                return None
        if step.start < 0:
            self._add("K501", step.start, number, f"{said} starts before time 0", -step.start)
        variables = (parameter.variable for parameter in action.parameters)
        return Act(number, step, action, dict(zip(variables, step.action.arguments, strict=True)))

    def _times(self) -> list[Fraction]:
        """All times at which something happens."""
        ends = (time for act in self.acts for time in (act.step.start, act.step.end))
        return sorted({*ends, *(change.at for change in self.problem.changes)})

    def _happen(self, time: Fraction) -> None:
        """All that happens at one time: conditions in the state before, then all effects
        together.
        """
        starting = [act for act in self.acts if act.step.start == time]
        ending = [act for act in self.acts if act.step.end == time and not act.action.instantaneous]
        timed = [change for change in self.problem.changes if change.at == time]
        for act in starting:
            self._durations(act)
            self._check(act, Moment.START)
        for act in ending:
            self._check(act, Moment.END)
        instants = list(self._instants(time, starting, ending, timed))
        self._together(instants)
        self._apply(instants)
        self.instants += instants
        for act in self.acts:
            if act.step.start <= time < act.step.end and not act.action.instantaneous:
                self._check(act, Moment.THROUGHOUT)

    def _instants(
        self, time: Fraction, starting: list[Act], ending: list[Act], timed: list[TimedChange]
    ) -> Iterator[Instant]:
        for act in starting:
            act.notice(self.moments, Moment.START)
            yield instant_of(act, Moment.START, time, self.moments)
        for act in ending:
            act.notice(self.moments, Moment.END)
            yield instant_of(act, Moment.END, time, self.moments)
        if timed:
            yield timed_instant(timed, self.moments)

    def _durations(self, act: Act) -> None:
        """Whether the duration of a step keeps its limits."""
        step = act.step
        if act.action.instantaneous and step.duration != 0:
            said = f"{act} has no duration, not {decimal(step.duration)}"
            self._add("K501", step.start, act.number, said, step.duration)
        if step.duration < 0:
            self._add(
                "K501", step.start, act.number, f"{act} lasts less than nothing", -step.duration
            )
        for limit in act.action.limits:
            try:
                amount = self.moments.amount(limit.amount, act.bindings, step.duration)
            except NoValue as lack:
                self._add("K501", step.start, act.number, f"the duration of {act}: {lack}")
                continue
            off = step.duration - amount
            wrong = {"=": abs(off), "<=": off, ">=": -off}[limit.relation]
            if wrong > TOLERANCE:
                said = (
                    f"{act} lasts {decimal(step.duration)}, not {limit.relation} {decimal(amount)}"
                )
                self._add("K501", step.start, act.number, f"{said}: {decimal(wrong)} off", wrong)

    def _check(self, act: Act, moment: Moment) -> None:
        """The conditions of a step at a moment, in the state as it is."""
        if moment is Moment.THROUGHOUT:
            act.notice(self.moments, moment)
        when = {Moment.START: "when it starts", Moment.END: "when it ends"}.get(moment)
        time = self._now(act, moment)
        for timed in act.action.conditions:
            if timed.moment is not moment:
                continue
            broken = self.moments.broken(timed.condition, act.bindings, act.step.duration)
            if broken is not None:
                said = when or f"throughout: it fails from {decimal(time)} on"
                off = f", by {decimal(broken.amount)}" if broken.amount is not None else ""
                message = f"{act}: {broken.said} does not hold {said}{off}"
                self._add("K501", time, act.number, message, broken.amount)

    def _now(self, act: Act, moment: Moment) -> Fraction:
        if moment is Moment.START:
            return act.step.start
        if moment is Moment.END:
            return act.step.end
        return max([act.step.start, *(instant.time for instant in self.instants)])

    def _together(self, instants: list[Instant]) -> None:
        """Instants at one time that exclude each other."""
        for one, two in itertools.combinations(instants, 2):
            self._excluded(one, two)

    def _excluded(self, one: Instant, two: Instant) -> None:
        if why := one.conflict(two):
            gap = abs(two.time - one.time)
            missing = self.problem.epsilon - gap
            apart = f"are only {decimal(gap)} apart" if gap else "are at the same instant"
            said = (
                f"{one} and {two} {apart}, but both touch {why}: {decimal(missing)} more is needed"
            )
            number = max(each.act.number if each.act else 0 for each in (one, two))
            self._add("K503", max(one.time, two.time), number, said, missing)

    def _separation(self) -> None:
        """Instants at different times that exclude each other and are less than epsilon apart."""
        for place, one in enumerate(self.instants):
            for two in self.instants[place + 1 :]:
                if two.time - one.time >= self.problem.epsilon:
                    break
                if two.time > one.time:
                    self._excluded(one, two)

    def _apply(self, instants: list[Instant]) -> None:
        """All effects of one time. An atom that one instant deletes and adds is true afterwards."""
        atoms: set[Atom] = set(self.moments.atoms)
        for instant in instants:
            atoms -= instant.deletes
        for instant in instants:
            atoms |= instant.adds
        values = dict(self.moments.values)
        for instant in instants:
            for lack in instant.lacks:
                self._add(
                    "K501",
                    instant.time,
                    instant.act.number if instant.act else 0,
                    f"{instant}: {lack}",
                )
            for kind, number, amount in sorted(
                instant.updates, key=lambda update: update[0] in ADDITIVE
            ):
                self._update(instant, values, kind, number, amount)
        self.moments = Moments(self.problem, frozenset(atoms), values)

    def _update(
        self,
        instant: Instant,
        values: dict[Function, Fraction],
        kind: str,
        number: Function,
        amount: Fraction,
    ) -> None:
        step = instant.act.number if instant.act else 0
        if kind == "assign":
            values[number] = amount
        elif number not in values:
            self._add("K501", instant.time, step, f"{instant}: {number} has no value")
        elif kind == "scale-down" and amount == 0:
            self._add("K501", instant.time, step, f"{instant}: {number} is divided by 0")
        elif kind in ADDITIVE:
            values[number] += amount if kind == "increase" else -amount
        else:
            values[number] = (
                values[number] * amount if kind == "scale-up" else values[number] / amount
            )
