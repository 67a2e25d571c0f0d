"""`cellwright motion problems` and `motion travel`: many motions in one cell."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from cellwright.engine.faces.cli.answers import Answer
from cellwright.engine.faces.cli.exits import INFEASIBLE
from cellwright.engine.faces.cli.working import Work, crew_asked, progress_of

if TYPE_CHECKING:
    from cellwright.engine.pipelines.motion.moving import Wish
    from cellwright.engine.pipelines.motion.problems import Problem


def generated(target: str, count: int, seed: int, tool: str, output: Path | None) -> Answer:
    """A new problem set, printed or written."""
    from rich.text import Text

    from cellwright.engine.pipelines.motion.moving import Site
    from cellwright.engine.pipelines.motion.problems import drawn, entries

    listed = entries(drawn(Site.of(target), count, seed, tool))
    if output is None:
        return Answer("found", raw=_file({"problems": listed}))
    output.write_text(_file({"problems": listed}), encoding="utf-8")
    said = f"{len(listed)} problems in {output}; replay them with: motion plan {target} --problems {output}"
    return Answer("found", {"problems": listed}, lambda: Text(said))


def replays(
    target: str, problems: Path, wished: "Callable[[], Wish]", output: Path | None, work: "Work"
) -> Answer:
    """What the planner makes of a saved set; exit code 10 if an answer is not the saved one."""
    from cellwright.engine.faces.cli.interruption import Interruption
    from cellwright.engine.formats.report import motion_tables as report
    from cellwright.engine.pipelines.motion.sets import replayed_set

    crew = crew_asked(work.jobs, work.cluster)
    with Interruption() as interrupted, progress_of("motions") as progress:
        found = replayed_set(target, _read(problems), wished(), crew, work.store, interrupted, progress)
    entry = report.replay_entry(found)
    if output is not None:
        output.write_text(_file(entry), encoding="utf-8")
    changed = any(each.same is False for each in found)
    return Answer(
        "changed" if changed else "found", entry, lambda: report.replay(found), INFEASIBLE if changed else 0
    )


def _read(path: Path) -> "list[Problem]":
    from cellwright.engine.pipelines.motion.problems import problems_in
    from cellwright.kb.files import read_file
    from cellwright.kb.json_text import parsed

    try:
        content = parsed(read_file(path).text)
    except ValueError:
        content = None
    return problems_in(content, str(path))


def _file(content: dict[str, object]) -> str:
    return json.dumps(content, indent=1) + "\n"


def table(target: str, tool: str, places: tuple[str, ...], facts: bool, work: "Work") -> Answer:
    """Travel times between the places of a cell; with `facts`, as facts for a problem file."""
    from cellwright.engine.faces.cli.interruption import Interruption
    from cellwright.engine.formats.report import motion_tables as report
    from cellwright.engine.pipelines.motion.sets import table_by
    from cellwright.kb.loader import find, load
    from cellwright.kb.syntax import SECONDS

    unit_s = float(SECONDS[load(find(target)).domain.time_unit])
    crew = crew_asked(work.jobs, work.cluster)
    with Interruption() as interrupted:
        found = table_by(target, tool, places, crew, work.store, interrupted)
    if facts:
        return Answer("found", raw="".join(f"  - {each}\n" for each in found.facts(unit_s)))
    return Answer("found", report.travel_entry(found, unit_s), lambda: report.travel(found))
