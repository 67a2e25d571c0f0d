"""`make fuzz`: mutated inputs for every reader, whole domains, and whole command lines, until the
time is over.

    python tests/fuzzing/campaign.py [--minutes 10] [--seed 1] [--only NAME] [--state FOLDER]
        [--show NAME NUMBER]

A case is known by seed, name and number, so a campaign goes on where it stopped, and `--show`
writes what a case was. Exit code 1 if a case raised what no reader promises, took more than 20 s of
the processor or more than 2 GB.
"""

import argparse
import json
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import asdict
from functools import cache
from pathlib import Path
from random import Random

sys.path[:0] = [str(Path(__file__).parents[2]), str(Path(__file__).parent)]

import fuzz_domains  # noqa: E402 - the path is set above
from fuzz_guards import Tally, batch  # noqa: E402
from fuzz_readers import REFUSALS, Reader  # noqa: E402
from fuzz_requests import PARSERS  # noqa: E402
from mutations import mutated  # noqa: E402

BATCH_S = 3.0  # seconds that a batch should take


def chance_of(seed: int, name: str, number: int) -> Random:
    """The generator of a case."""
    return Random(f"{seed}/{name}/{number}")


def written(reader: Reader, seed: int, number: int, folder: Path) -> Path:
    """The input of a case in a folder."""
    path = folder / reader.file
    path.write_bytes(mutated(chance_of(seed, reader.name, number), reader.kind, reader.seeds()))
    return path


def accompany(reader: Reader, folder: Path) -> None:
    """Write the files that a reader needs beside its own into a folder."""
    for name, text in reader.beside.items():
        (folder / name).write_text(text, "utf-8")


def case_of(reader: Reader, seed: int, folder: Path) -> Callable[[int], bool]:
    """A function that runs a case and says whether its input was accepted."""

    def case(number: int) -> bool:
        path = written(reader, seed, number, folder)
        try:
            reader.read(path)
        except REFUSALS:
            return False
        return True

    return case


Cases = Callable[[int, Path], Callable[[int], bool]]


def targets() -> dict[str, Cases]:
    """All that is tried, by name: for a seed and a folder, a function that runs a case."""
    found: dict[str, Cases] = {each.name: _cases(each) for each in PARSERS}
    found["whole domains"] = fuzz_domains.domains
    found["command lines"] = fuzz_domains.commands
    return found


def _cases(reader: Reader) -> Cases:
    def cases(seed: int, folder: Path) -> Callable[[int], bool]:
        accompany(reader, folder)
        warm(reader, folder)
        return case_of(reader, seed, folder)

    return cases


@cache
def _warmed() -> set[str]:
    return set()


def warm(reader: Reader, folder: Path) -> None:
    """Load what a reader needs, by a sound input, so that no case has to."""
    if reader.name not in _warmed():
        _warmed().add(reader.name)
        (folder / reader.file).write_bytes(reader.seeds()[0])
        with suppress(*REFUSALS):
            reader.read(folder / reader.file)


class State:
    """How far a campaign is, in a file: for each target the number of the next case, and the
    tally.
    """

    def __init__(self, folder: Path, seed: int) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.file = folder / f"seed_{seed}.json"
        said = json.loads(self.file.read_text("utf-8")) if self.file.exists() else {}
        self.tallies = {name: _tally(each) for name, each in said.items()}

    def note(self, name: str, more: Tally) -> None:
        """Count a batch, and write the state down."""
        self.tallies.setdefault(name, Tally()).add(more)
        text = json.dumps({name: asdict(each) for name, each in self.tallies.items()}, indent=1)
        new = self.file.with_suffix(".new")
        new.write_text(text, "utf-8")
        new.replace(self.file)


def _tally(said: dict[str, object]) -> Tally:
    found = Tally(**said)  # type: ignore[arg-type]
    found.failures = {int(number): what for number, what in found.failures.items()}
    return found


def run(state: State, seed: int, minutes: float, only: str) -> None:
    """Run batches, each target in turn, until the time is over.

    What was tried least comes first, in seconds.
    """
    end, spent = time.monotonic() + minutes * 60, dict[str, float]()
    chosen = {name: each for name, each in targets().items() if only in name}
    rate = dict.fromkeys(chosen, 20.0)
    while time.monotonic() < end:
        name = min(chosen, key=lambda each: spent.get(each, 0.0))
        with tempfile.TemporaryDirectory() as folder:
            began = time.monotonic()
            first = state.tallies.get(name, Tally()).cases
            numbers = range(first, first + max(1, round(min(BATCH_S, end - began) * rate[name])))
            found = batch(numbers, chosen[name](seed, Path(folder)))
        took = max(time.monotonic() - began, 0.01)
        rate[name] = min(len(numbers) / took, 5 * rate[name])
        spent[name] = spent.get(name, 0.0) + took
        state.note(name, found)
        for number, what in found.failures.items():
            print(f"{name} {number}: {what}", flush=True)


def table(state: State) -> Iterator[str]:
    """The table of a campaign, in Markdown."""
    yield "| reader | cases | refused | accepted | exceptions | slowest, s | largest, MB |"
    yield "|---|--:|--:|--:|--:|--:|--:|"
    for name, each in sorted(state.tallies.items()):
        counts = f"{each.cases} | {each.refused} | {each.accepted} | {len(each.failures)}"
        yield f"| {name} | {counts} | {each.slowest_s:.2f} | {each.largest_mb:.0f} |"
    whole = Tally()
    for each in state.tallies.values():
        whole.add(each)
    bad = sum(len(each.failures) for each in state.tallies.values())
    counts = f"{whole.cases} | {whole.refused} | {whole.accepted} | {bad}"
    yield f"| all | {counts} | {whole.slowest_s:.2f} | {whole.largest_mb:.0f} |"


def show(name: str, number: int, seed: int, output: Path) -> None:
    """Write the input of a case into a folder."""
    shutil.rmtree(output, ignore_errors=True)
    output.mkdir(parents=True)
    for reader in PARSERS:
        if reader.name == name:
            accompany(reader, output)
            print(written(reader, seed, number, output))
            return
    print(fuzz_domains.written(name, seed, number, output))


def main() -> int:
    """Run what the command line asks for; returns the exit code."""
    asked = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    asked.add_argument("--minutes", type=float, default=10.0)
    asked.add_argument("--seed", type=int, default=1)
    asked.add_argument("--only", default="", help="targets whose names contain this")
    asked.add_argument("--state", type=Path, default=Path(".fuzz"))
    asked.add_argument("--show", nargs=2, metavar=("NAME", "NUMBER"))
    given = asked.parse_args()
    if given.show:
        show(given.show[0], int(given.show[1]), given.seed, given.state / "shown")
        return 0
    state = State(given.state, given.seed)
    if not any(given.only in name for name in targets()):
        asked.error(f"no target has '{given.only}' in its name: {', '.join(targets())}")
    try:
        run(state, given.seed, given.minutes, given.only)
    except KeyboardInterrupt:
        print("stopped: the next call with this seed goes on from here")
    print("\n".join(table(state)))
    return int(any(each.failures for each in state.tallies.values()))


if __name__ == "__main__":
    sys.exit(main())
