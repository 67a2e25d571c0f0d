"""What is demanded of measured values in QIF: values that answer the same demand share one characteristic."""

from typing import NamedTuple

from cellwright.kb.model.results import Measured

LENGTHS = ("m", "cm", "mm", "um", "nm", "in")


class Demand(NamedTuple):
    """What is measured, in which unit, and what it should be."""

    of: str
    quantity: str
    unit: str
    nominal: float | None
    lower: float | None
    upper: float | None


def demand_of(measured: Measured) -> Demand:
    """The demand that a value answers."""
    return Demand(
        measured.of, measured.quantity, measured.unit, measured.nominal, measured.lower, measured.upper
    )


def kind_of(demand: Demand) -> str:
    """The beginning of the names of the QIF elements for a demand."""
    if demand.unit in LENGTHS:
        return "UserDefinedLinear"
    limited = demand.lower is not None or demand.upper is not None
    whole = demand.nominal is not None and limited and demand.unit.split() == [demand.unit]
    return "UserDefinedUnit" if whole else "UserDefinedAttribute"
