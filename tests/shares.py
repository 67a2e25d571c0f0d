"""How many of its examples a law tries: a share of them in the quick suite, all in every other."""

from collections.abc import Callable

from hypothesis import settings

QUICK = 0.3
FEWEST = 5  # of so few no share is taken


def share(examples: int) -> int:
    """How many of these examples the quick suite tries."""
    return max(min(examples, FEWEST), round(QUICK * examples))


def shorten(law: Callable[..., object]) -> None:
    """Make a law try a share of its examples.

    It is written where `@settings` writes, and Hypothesis' own plugin.
    """
    function = getattr(law, "__func__", law)
    own: settings = function._hypothesis_internal_use_settings
    function._hypothesis_internal_use_settings = settings(own, max_examples=share(own.max_examples))
