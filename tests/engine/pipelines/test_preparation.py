"""A preparation tells of every problem, whatever ends it."""

from collections.abc import Generator, Sequence
from pathlib import Path
from typing import Any

from cellwright.engine.pipelines.preparation import prepare
from cellwright.engine.pipelines.preparation.results import Prepared
from cellwright.engine.pipelines.units import Unit
from cellwright.engine.stages.planning import Limits
from cellwright.kb.stopping import Stopped


class CutOff:
    """A crew whose time is over after the first unit, where nothing asks whether to stop."""

    def carry_out(
        self, _kind: Any, units: Sequence[Unit[Any]], _interrupted: Any
    ) -> Generator[tuple[Unit[Any], Any], None, None]:
        yield units[0], Prepared("first", "found")
        raise Stopped


def test_what_was_found_before_the_end_of_the_time_is_told_with_what_is_left(tmp_path: Path) -> None:
    paths = [Path(f"domains/bulkhead/problems/{name}.yaml") for name in ("one_point", "both_tools")]
    told = prepare(paths, str(tmp_path / "cell.db"), Limits(100), CutOff()).problems
    assert [(each.problem, each.status) for each in told] == [
        ("first", "found"),
        ("both_tools", "gave up"),
    ]
