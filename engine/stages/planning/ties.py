"""How searches break ties: in the order in which things are found, or by chance with a seed."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from random import Random


def chance(seed: int) -> "Random | None":
    """A source of chance; None for the seed 0, with which the order is kept."""
    if not seed:
        return None
    from random import Random  # takes a millisecond to load, and most searches have no seed

    return Random(seed)
