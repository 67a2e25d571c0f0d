"""Costs as a task says them. The engine counts in whole numbers; a task may have fractions."""

from decimal import Decimal
from fractions import Fraction

from cellwright.kb.model.domain_model import Domain


def cost_number(cost: int, domain: Domain) -> int | Decimal | str:
    """A cost of the engine as a number of the task: whole, or an exact decimal.

    A third is no decimal: it is the text `1/3`.
    """
    exact = Fraction(cost, domain.unit_of_cost)
    if exact.denominator == 1:
        return exact.numerator
    return decimal if (decimal := _decimal(exact)) is not None else str(exact)


def cost_text(cost: int, domain: Domain) -> str:
    """A cost of the engine as people write it."""
    value = cost_number(cost, domain)
    return f"{value:f}" if isinstance(value, Decimal) else str(value)


def _decimal(exact: Fraction) -> Decimal | None:
    """The decimal that is equal to a fraction; None if there is none."""
    places, rest = 0, exact.denominator
    while rest % 10 == 0:
        places, rest = places + 1, rest // 10
    for factor in (2, 5):
        while rest % factor == 0:
            places, rest = places + 1, rest // factor
    return (
        None
        if rest != 1
        else Decimal(f"{exact.numerator * 10**places // exact.denominator}e-{places}")
    )
