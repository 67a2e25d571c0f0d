"""What limits expansions: a number that is given, else a limit of time alone, else the default."""

from unittest.mock import patch

import pytest
from typer.testing import CliRunner

import cellwright
from cellwright.engine.faces.cli import app
from cellwright.engine.stages.planning import UNLIMITED, expansions_within
from cellwright.engine.stages.planning.search_control import MAX_EXPANSIONS

run = CliRunner().invoke


def test_a_limit_of_time_governs_unless_a_number_is_given() -> None:
    assert expansions_within(None, None) == MAX_EXPANSIONS
    assert expansions_within(None, 60.0) == UNLIMITED
    assert expansions_within(7, 60.0) == 7


@pytest.mark.parametrize("verb", ["plan", "schedule", "explain"])
@pytest.mark.parametrize(
    ("options", "code"),
    [((), 12), (("--time-limit", "60"), 0), (("--time-limit", "60", "--expansions", "1"), 12)],
)
def test_the_default_number_ends_no_search_with_a_time_limit(
    verb: str, options: tuple[str, ...], code: int
) -> None:
    """The default is made so small that the search for this plan would end at it."""
    with patch("cellwright.engine.stages.planning.search_control.MAX_EXPANSIONS", 1):
        assert run(app, [verb, "bulkhead/both_tools", *options]).exit_code == code


def test_so_it_is_in_the_library() -> None:
    with patch("cellwright.engine.stages.planning.search_control.MAX_EXPANSIONS", 1):
        assert cellwright.plan("bulkhead/both_tools").plan is None
        assert cellwright.plan("bulkhead/both_tools", seconds=60).plan is not None
