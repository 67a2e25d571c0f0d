"""A quickly made dataclass means what the standard decorator makes of the same class."""

import copy
import dataclasses
import pickle
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

import kb.records

values = st.one_of(st.integers(-3, 3), st.tuples(st.booleans()), st.sampled_from("ab"))


def classes(dataclass: Callable[..., Any]) -> tuple[type, type, type]:
    """A class with every kind of field, one that inherits from it, and one without fields."""

    @dataclass(frozen=True, slots=True)
    class Part:
        """A part."""

        name: Any
        size: Any = 2
        marks: list[int] = dataclasses.field(default_factory=lambda: [1])

        def __post_init__(self) -> None:
            if self.size == 3:
                object.__setattr__(self, "size", "three")

        @property
        def twice(self) -> Any:
            return self.size * 2

    @dataclass(frozen=True, slots=True)
    class Screw(Part):
        """A part with one more field, a default of its own and an `__eq__` of its own."""

        pitch: Any = None
        size: Any = 4

        def __eq__(self, other: object) -> bool:
            return isinstance(other, Screw) and self.name == other.name

        def __hash__(self) -> int:
            return 5

    @dataclass(frozen=True, slots=True)
    class Nothing:
        """No fields at all."""

    return Part, Screw, Nothing


STANDARD, QUICK = classes(dataclasses.dataclass), classes(kb.records.dataclass)
BOTH = list(zip(STANDARD, QUICK, strict=True))


@dataclasses.dataclass(frozen=True, slots=True)
class Bolt:
    """The standard one, at a place from which it can be pickled."""

    name: str
    length: int = 2


Quick = kb.records.dataclass(frozen=True, slots=True)(
    type("Quick", (), {"__annotations__": {"name": str, "length": int}, "length": 2, "__module__": __name__})
)


def outcome(call: Callable[[], Any]) -> tuple[str, Any]:
    """What a call returns, or the type of what it raises."""
    try:
        return "returned", call()
    except Exception as error:
        return "raised", type(error)


@given(st.lists(values, max_size=4), st.dictionaries(st.sampled_from(["name", "size", "pitch"]), values))
def test_the_same_arguments_give_the_same_values_or_the_same_error(
    given_: list[Any], named: dict[str, Any]
) -> None:
    for standard, quick in BOTH:
        expected = outcome(lambda made=standard: dataclasses.asdict(made(*given_, **named)))
        assert outcome(lambda made=quick: dataclasses.asdict(made(*given_, **named))) == expected


@given(st.tuples(values, values), st.tuples(values, values))
def test_equality_hash_and_text_are_the_same(one: tuple[Any, Any], other: tuple[Any, Any]) -> None:
    for standard, quick in BOTH[:2]:
        assert (quick(*one) == quick(*other)) == (standard(*one) == standard(*other))
        assert repr(quick(*one)) == repr(standard(*one))
        assert quick(*one) != standard(*one)
    assert hash(Quick(*one)) == hash(Bolt(*one))


def test_what_is_made_of_a_value_is_the_same() -> None:
    for standard, quick in BOTH:
        assert quick.__match_args__ == standard.__match_args__
        assert quick.__slots__ == standard.__slots__
        assert (quick.__name__, quick.__qualname__) == (standard.__name__, standard.__qualname__)
        assert not hasattr(quick(*"a" * len(quick.__match_args__)), "__dict__")
    part = QUICK[0]("a")
    assert dataclasses.replace(part, size=5) == QUICK[0]("a", 5)
    assert part.twice == 4
    assert copy.deepcopy(part) == part
    assert pickle.loads(pickle.dumps(Quick("a", 7))) == Quick("a", 7)
    assert QUICK[0]("a").marks is not part.marks


@pytest.mark.parametrize("made", [STANDARD[0]("a"), QUICK[0]("a"), QUICK[1]("a")])
def test_nothing_can_be_changed(made: Any) -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        made.size = 1
    with pytest.raises(dataclasses.FrozenInstanceError):
        del made.size


def test_other_kinds_of_dataclasses_are_left_to_the_standard_decorator() -> None:
    @kb.records.dataclass(frozen=True, slots=True, order=True)
    class Ordered:
        number: int

    @kb.records.dataclass
    class Open:
        number: int

    assert Ordered(1) < Ordered(2)
    changed = Open(1)
    changed.number = 2
    assert changed == Open(2)
