"""A mutation run tries only the tests that can notice a mutant, and exchanges no more than what
the mutant changes.
"""

import ast
import sys
from collections.abc import Callable
from types import FunctionType
from typing import Any

import pytest

from tests.places import TOP

sys.path.append(str(TOP / "benchmarks"))

from mutation_reach import Lines, Measured, Tracer, chosen, outermost, replaced, statement

FILE = "/somewhere/judge.py"
TEXT = """LIMIT = 3

@decorated
def allowed(
    number,
    least=0,
):
    if number < LIMIT:
        return any(
            each > number
            for each in (1, 2)
        )
    return False

class Judge:
    kind = "strict"

    def says(self):
        def inner():
            return 1
        return inner()
"""


def names() -> dict[str, Any]:
    found: dict[str, Any] = {
        "decorated": lambda function: lambda *values: function(*values),
        "__name__": "m",
    }
    exec(compile(TEXT, FILE, "exec"), found)
    return found


def reached(run: Callable[[], object]) -> Lines | None:
    tracer, before = Tracer([FILE]), sys.gettrace()
    tracer.on()
    try:
        run()
    finally:
        tracer.off()
        sys.settrace(before)
    return tracer.lines()


@pytest.mark.parametrize(
    ("line", "lines"),
    [
        (1, [1]),
        (6, list(range(4, 14))),  # a default belongs to the definition
        (8, [8, 9, 10, 11, 12]),  # a condition, with what depends on it
        (10, [9, 10, 11, 12]),
        (13, [13]),
        (16, [16]),
        (20, [20]),
    ],
)
def test_a_mutant_lies_in_the_innermost_statement(line: int, lines: list[int]) -> None:
    assert list(statement(TEXT, line)) == lines


def test_a_mutant_of_a_decorator_may_lie_anywhere() -> None:
    assert set(range(1, 22)) <= set(statement(TEXT, 3))


def test_lines_are_noted_of_what_runs_and_of_generators_in_it() -> None:
    made = names()
    assert reached(lambda: made["allowed"](1)) == {FILE: frozenset((8, 9, 10, 11))}
    assert reached(lambda: made["allowed"](4)) == {FILE: frozenset((8, 13))}
    assert reached(lambda: made["Judge"]().says()) == {FILE: frozenset((19, 20, 21))}


def test_what_runs_on_import_is_noted() -> None:
    lines = reached(names)
    assert lines is not None
    assert {1, 3, 16} <= lines[FILE]
    assert lines[FILE].isdisjoint((8, 13, 20))


def test_of_a_test_that_starts_processes_nothing_is_known() -> None:
    tracer = Tracer([FILE])
    tracer._audited("open", ())
    assert tracer.lines() == {FILE: frozenset()}
    tracer._audited("subprocess.Popen", ())
    assert tracer.lines() is None
    assert Measured("starts", 1.0, None).reaches(FILE, range(1, 2))


def test_tests_that_reach_the_statement_run_cheapest_first() -> None:
    tests = [
        Measured("dear", 2.0, {FILE: frozenset((8, 9))}),
        Measured("elsewhere", 0.1, {FILE: frozenset((13,))}),
        Measured("cheap", 0.5, {FILE: frozenset((9,))}),
        Measured("unknown", 1.0, None),
    ]
    assert [each.name for each in chosen(tests, FILE, range(9, 13))] == ["cheap", "unknown", "dear"]


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("LIMIT = 3", "LIMIT = 4"),
        ("least=0", "least=1"),
        ("@decorated\n", ""),
        ('"strict"', '"mild"'),
        ("return False", "return 0 if least else False\n\nlater = 1"),
    ],
)
def test_what_changes_beside_a_body_cannot_be_exchanged(old: str, new: str) -> None:
    assert replaced(TEXT, TEXT.replace(old, new), FILE) is None


@pytest.mark.parametrize(
    ("old", "new", "name"),
    [("number < LIMIT", "number > LIMIT", "allowed"), ("return 1", "return 2", "says")],
)
def test_the_code_of_the_changed_function_is_found(old: str, new: str, name: str) -> None:
    found = replaced(TEXT, TEXT.replace(old, new), FILE)
    assert found is not None
    assert [each.co_name for each in found] == [name, name]
    assert found[0] != found[1]


def test_a_function_with_exchanged_code_does_what_the_new_text_says() -> None:
    found = replaced(TEXT, TEXT.replace("return 1", "return 2"), FILE)
    judge = names()["Judge"]
    function: FunctionType = judge.says
    assert found is not None
    assert function.__code__ == found[0]
    function.__code__ = found[1]
    assert judge().says() == 2


def test_functions_in_functions_belong_to_the_outer_one() -> None:
    assert [each.name for each in outermost(ast.parse(TEXT))] == ["allowed", "says"]
