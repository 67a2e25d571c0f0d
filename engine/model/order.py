"""Whether the orders that a partially ordered plan allows are valid."""

from dataclasses import dataclass

from cellwright.kb.model.plan import StepId


@dataclass(frozen=True, slots=True)
class Counterexample:
    """An order that fails: its last step cannot be done, or all steps are done and the goal does not hold."""

    order: tuple[StepId, ...]
    at_the_goal: bool


@dataclass(frozen=True, slots=True)
class Verdict:
    """Whether every order is valid; None if this is unknown."""

    valid: bool | None
    counterexample: Counterexample | None = None
