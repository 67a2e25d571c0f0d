"""The whole measurement: every benchmark in one run, with every figure that an issue has named on
one page.

    python benchmarks/whole.py [--profile quick|full] [--only PART ...] [--minutes N]
        [--kept FOLDER] [--cluster ADDRESS] [--list]

The quick profile ends within 40 minutes: what is left then is told on the page as not run. The full
one takes a night or two. The result of each part is kept as soon as it is there; after Ctrl-C, a
crash or a power failure the next call goes on with the next part, and parts that keep what they
have tried go on behind it, as long as no source has changed. When all parts of the profile have
run, the page PROFILE.md and its data PROFILE.json are in FOLDER (`.bench`), the former ones beside
them as PROFILE-before, and the next call begins anew. A part that fails, and a peer or a data set
that is not there, stops nothing. With a cluster, the parts that count outcomes in units of work
(the fault matrix) are carried out by it; all others measure times of this machine. Exits with 1 if
something regressed, misses a bar or failed.
"""

import argparse
import hashlib
import json
import os
import shutil
import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

from whole_figures import Part
from whole_page import Measured, missed, page, peers, regressed, this_machine
from whole_parts_cells import CELLS
from whole_parts_plans import PLANS
from whole_runs import Bench, run_all

TOP = Path(__file__).resolve().parents[1]
PARTS = (*PLANS, *CELLS)
MINUTES = {"quick": 40.0, "full": 60.0 * 72}
SOURCES = ("kb", "engine", "domains", "benchmarks")


def version_of(top: Path) -> str:
    """A digest of everything that can change a figure."""
    digest = hashlib.sha256()
    for folder in SOURCES:
        for path in sorted((top / folder).rglob("*")):
            if path.is_file() and path.suffix in (".py", ".pxd", ".h", ".yaml", ".lp", ".lark"):
                digest.update(str(path.relative_to(top)).encode() + path.read_bytes())
    return digest.hexdigest()[:12]


def last(folder: Path, profile: str) -> Measured | None:
    """The last whole measurement in a profile; None if there is none that can be read."""
    try:
        return Measured.read(json.loads((folder / f"{profile}.json").read_text("utf-8")))
    except (OSError, ValueError, TypeError, KeyError):
        return None


def measure(bench: Bench, parts: Sequence[Part], minutes: float, today: str, beside: Path) -> int:
    """Run what is left, and write the page. Returns the exit code.

    When every part has a result, the measurement is closed: the page and its data take the place of
    the last ones.
    """
    code, before = 0, last(bench.folder, bench.profile)
    try:
        run_all(bench, parts, minutes)
    except KeyboardInterrupt:
        code = 130
    results = [each for part in parts if (each := bench.known(part.name)) is not None]
    now = Measured(
        today, bench.profile, bench.version, this_machine(), peers(beside), tuple(results)
    )
    wanted = [each for each in parts if each.arguments(bench.profile) is not None]
    whole = len(results) == len(wanted)
    text = page(now, before, parts)
    bench.folder.mkdir(parents=True, exist_ok=True)
    if not whole and code == 0 and bench.profile == "quick":
        whole = True  # the minutes are over: this is what the quick profile can tell here
    if whole and code == 0:
        _close(bench, now, text)
    else:
        (bench.folder / f"{bench.profile}-so-far.md").write_text(text, "utf-8")
        print(f"{len(results)} of {len(wanted)} parts; the next call goes on")
    bad = [*regressed(now, before, parts), *missed(now, parts), *now.failed()]
    print(*bad, sep="\n")
    return code or int(bool(bad))


def _close(bench: Bench, now: Measured, text: str) -> None:
    """Put the page and its data in their place, keep the former ones beside, and forget the
    parts.
    """
    for ending, content in (("md", text), ("json", json.dumps(now.document(), indent=1) + "\n")):
        file = bench.folder / f"{bench.profile}.{ending}"
        if file.exists():
            file.replace(bench.folder / f"{bench.profile}-before.{ending}")
        file.write_text(content, "utf-8")
    (bench.folder / f"{bench.profile}-so-far.md").unlink(missing_ok=True)
    shutil.rmtree(bench.folder / bench.profile, ignore_errors=True)
    print(bench.folder / f"{bench.profile}.md")


def main() -> int:
    """Measure what the command line asks for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--profile", choices=tuple(MINUTES), default="quick")
    parser.add_argument(
        "--only",
        nargs="+",
        choices=[each.name for each in PARTS],
        help="these parts alone, in a folder of their own",
    )
    parser.add_argument("--minutes", type=float, help="no part begins after so many")
    parser.add_argument("--kept", type=Path, default=TOP / ".bench")
    parser.add_argument(
        "--cluster", default="", help="the address of a Dask cluster, for work in units"
    )
    parser.add_argument("--list", action="store_true", help="list the parts, and end")
    asked = parser.parse_args()
    if asked.list:
        for part in PARTS:
            words = part.arguments(asked.profile)
            print(
                f"{part.name:16} "
                f"{'not in this profile' if words is None else ' '.join((part.script, *words))}"
            )
        return 0
    parts = [each for each in PARTS if not asked.only or each.name in asked.only]
    folder = asked.kept / "some" if asked.only else asked.kept
    beside = TOP / ".peers" / "bin" / "python"
    planners = str(beside) if beside.exists() else ""
    bench = Bench(
        folder, asked.profile, version_of(TOP), TOP, peers=planners, cluster=asked.cluster
    )
    minutes = MINUTES[asked.profile] if asked.minutes is None else asked.minutes
    os.environ.setdefault("CELLWRIGHT_DATA", str(TOP / "../shared/data"))
    today = datetime.now(UTC).date().isoformat()
    return measure(bench, parts, minutes, today, TOP / ".peers")


if __name__ == "__main__":
    sys.exit(main())
