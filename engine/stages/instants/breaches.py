"""What the checker finds wrong in a plan with times, and by how much."""

from dataclasses import dataclass
from fractions import Fraction


@dataclass(frozen=True, slots=True)
class Breach:
    """A broken condition: its code, when, of which step (from 1; 0 for none), in words, and by
    how much it is broken.
    """

    code: str
    time: Fraction
    step: int
    message: str
    amount: Fraction | None = None

    def __str__(self) -> str:
        return self.message


def decimal(value: Fraction) -> str:
    """A number with as many decimals as it has, at most six."""
    text = f"{float(value):.6f}".rstrip("0").rstrip(".")
    return text if text not in ("", "-0") else "0"
