"""Walks through values of the model: every value inside one, and every name in it."""

from collections.abc import Iterator
from dataclasses import fields, is_dataclass

from cellwright.kb.model.conditions import Aggregate, Parameter
from cellwright.kb.terms import Function


def names(value: object) -> Iterator[str]:
    """The names of all predicates, terms and types in a value of the model, repeated as they
    repeat.
    """
    for each in values(value):
        if isinstance(each, Function):
            yield each.name
        if isinstance(each, Parameter):
            yield each.type
        if isinstance(each, Aggregate):
            yield from (name for name, _ in each.uses)


def values(value: object) -> Iterator[object]:
    """A value of the model and all values inside it. What an aggregate counts is text."""
    yield value
    if is_dataclass(value) and not isinstance(value, Aggregate):
        for each in fields(value):
            yield from values(getattr(value, each.name))
    elif isinstance(value, tuple):
        for each in value:
            yield from values(each)
