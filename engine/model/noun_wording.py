"""Words of answers: a number of things, and a name with its meaning."""


def count_noun(number: int, noun: str) -> str:
    """A number of things: `1 step`, `2 steps`."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def name_with_meaning(name: str, says: str) -> str:
    """A name with what it means, if anybody has said it."""
    return f"{name}: {says}" if says else name
