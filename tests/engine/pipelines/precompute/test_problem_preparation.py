"""A preparation tells of every problem, whatever ends it."""

from collections.abc import Generator, Sequence
from pathlib import Path
from typing import Any

from cellwright.engine.pipelines.jobs import WorkUnit
from cellwright.engine.pipelines.precompute import prepare_problems
from cellwright.engine.pipelines.precompute.preparation_results import PreparedProblem
from cellwright.engine.stages.planning import SearchLimits
from cellwright.kb.stopping import StoppedByCaller


class CutOff:
    """A crew whose time is over after the first unit, where nothing asks whether to stop."""

    def carry_out(
        self, _kind: Any, units: Sequence[WorkUnit[Any]], _interrupted: Any
    ) -> Generator[tuple[WorkUnit[Any], Any], None, None]:
        yield units[0], PreparedProblem("first", "found")
        raise StoppedByCaller


def test_what_was_found_before_the_end_of_the_time_is_told_with_what_is_left(
    tmp_path: Path,
) -> None:
    paths = [Path(f"domains/bulkhead/problems/{name}.yaml") for name in ("one_point", "both_tools")]
    told = prepare_problems(paths, str(tmp_path / "cell.db"), SearchLimits(100), CutOff()).problems
    assert [(each.problem, each.status) for each in told] == [
        ("first", "found"),
        ("both_tools", "gave up"),
    ]
