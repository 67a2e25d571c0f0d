"""What is found out about the orders that a partially ordered plan allows."""

from dataclasses import dataclass

from kb.model.plan import StepId


@dataclass(frozen=True, slots=True)
class Counterexample:
    """An order that fails: its last step cannot be done, or every step is done and the goal does not hold."""

    order: tuple[StepId, ...]
    at_the_goal: bool


@dataclass(frozen=True, slots=True)
class Verdict:
    """Whether every order is valid; None if that was not found out."""

    valid: bool | None
    counterexample: Counterexample | None = None
