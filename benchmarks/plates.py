"""Days with microplates in the bundled cells `screening` and `elisa`, through `cellwright plan`:
makespan, bound over all plans, and what the processor and memory gave for it.

    python benchmarks/plates.py [--plates N ...] [--elisa N ...] [--readers N ...] [--seconds N]
                                [--json FILE]

Beside a screening day run a greedy first fit and a CP-SAT model of our own, with the greedy day as
a hint and without, one worker each, for as long as `plan` took of the processor (or N seconds, if
that is less). The model knows the cell: a plate goes straight on, or by way of its own place.
`--readers` gives the day three readers, of which one is slower, and reads last ten minutes. Exits
with 1 when a bar is missed: as good as CP-SAT and the first fit; 40 plates in 13,200 s; from 40
plates on within 15 % of the bound; 200 in 120 s and 1.5 GB; every reader used.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ortools.sat.python import cp_model
from rich.console import Console
from rich.table import Table

from cellwright.kb.loader import bundled_domains

PICK, MOVE = 7, 15  # seconds until a place is free, and until a plate is there
STATIONS = ("dispenser", "incubator", "washer", "dispenser", "reader")
LASTS = (120, 3600, 60, 60, 120)
STAYS = (600, 3780, 360, 600, 600)
CAPACITY = {"arm": 1, "dispenser": 1, "incubator": 32, "washer": 1, "reader": 1}
HOME_LIMIT = "longest_stay(hotel, 60).\n"  # without it, plates may wait in their own places
MOST_S, MOST_MB, MOST_GAP = 120.0, 1500.0, 0.15
SCREENING = (
    "dispensed(P, compounds, 100), incubated(P, 1 h), washed(P, 3), "
    "dispensed(P, stop_solution, 50), readout(P, 450), stored(P)"
)
ELISA = (
    "added(P, conjugate, 100), incubated(P, 30 min), washed(P, 3), added(P, substrate, 100), "
    "developed(P, 10 min), added(P, stop_solution, 50), readout(P, 450), stored(P)"
)
READ_LONG = ("time: 2 min", "time: 10 min")
READERS = """  reader_2: {device: plate_reader, time: 10 min, readout: readout}
  reader_3: {device: plate_reader, time: 15 min, readout: readout}
units:"""


@dataclass(frozen=True)
class Line:
    """One day; a peer that found nothing has 0."""

    day: str
    makespan: int
    bound: int
    seconds: float
    peak_mb: float
    greedy: int = 0
    solver: int = 0
    hinted: int = 0
    missed: str = ""


def cell(folder: Path, name: str, plates: int, *changes: tuple[str, str]) -> Path:
    """A copy of a bundled cell with room for so many plates, and with changes of its texts."""
    home = folder / f"{name}_{plates}_{len(changes)}"
    shutil.copytree(
        bundled_domains()[name], home, ignore=shutil.ignore_patterns("golden", "problems")
    )
    for file in (home / "domain.yaml", home / "rules.lp"):
        text = file.read_text("utf-8")
        for size in ("40", "48"):
            text = text.replace(
                f"plate_hotel, capacity: {size}", f"plate_hotel, capacity: {max(48, plates)}"
            )
        for old, new in changes:
            text = text.replace(old, new, 1)
        file.write_text(text, "utf-8")
    return home


def problem(home: Path, domain: str, plates: int, initial: str, stages: str) -> Path:
    """The problem of so many plates."""
    names = ", ".join(f"plate_{n}" for n in range(1, plates + 1))
    own = ", ".join(f"own_depot(plate_{n}, slot(hotel, {n}))" for n in range(1, plates + 1))
    (home / "problems").mkdir()
    file = home / "problems" / f"day{plates}.yaml"
    file.write_text(
        f"problem: day{plates}\ndomain: {domain}\nobjects:\n  probe: [plate_1..{plates}]\n"
        f"statics:\n  - {own}\ninitial:\n  - {initial}\n"
        f"workflow:\n  - for: {{P: [{names}]}}\n    stages: {stages}\n",
        "utf-8",
    )
    return file


def planned(file: Path) -> tuple[dict[str, Any], float, float]:
    """The answer of `plan`, its seconds of the processor, and its peak in megabytes."""
    command = [sys.executable, "-m", "cellwright.engine.faces.cli", "plan", str(file)]
    with subprocess.Popen([*command, "--format", "json"], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        answer = process.stdout.read()
        _, _, used = os.wait4(process.pid, 0)
        process.returncode = 0
    return json.loads(answer)["data"], used.ru_utime + used.ru_stime, used.ru_maxrss / 1000


def measured(day: str, file: Path) -> tuple[Line, dict[str, Any]]:
    """One day, planned; and the answer."""
    data, seconds, peak = planned(file)
    schedule = data["makespan"] if isinstance(data.get("makespan"), dict) else {}
    proved = schedule.get("proved") and "all plans" in schedule.get("scope", "")
    bound = schedule.get("all_plans") or (schedule["makespan"] if proved else 0)
    return Line(day, schedule.get("makespan", 0), bound, round(seconds, 1), round(peak)), data


# the first fit


@dataclass
class Taken:
    """When each resource is taken, and how many there are."""

    spans: dict[str, list[tuple[int, int]]]

    def free_from(self, name: str, begin: int, end: int) -> int | None:
        """When to try again; None if there is one left all the time."""
        cuts = [(b, e) for b, e in self.spans[name] if b < end and begin < e]
        if len(cuts) < CAPACITY[name]:
            return None
        for instant in sorted({begin, *(b for b, _ in cuts if b >= begin)}):
            there = sorted(e for b, e in cuts if b <= instant < e)
            if len(there) >= CAPACITY[name]:
                return there[len(there) - CAPACITY[name]]
        return None


def first_fit(plates: int) -> list[list[int]]:
    """The moves of each plate, begun as early as they fit, one plate after another."""
    taken, days = Taken({name: [] for name in CAPACITY}), []
    for _ in range(plates):
        moves = [0] * (len(STATIONS) + 1)
        while raised(moves, taken):
            pass
        days.append(moves)
        taken.spans["arm"] += [(begin, begin + MOVE) for begin in moves]
        for number, name in enumerate(STATIONS):
            taken.spans[name].append((moves[number] + PICK, moves[number + 1] + PICK))
    return days


def raised(moves: list[int], taken: Taken) -> bool:
    """Whether a move had to begin later."""
    for number, begin in enumerate(moves):
        if (later := taken.free_from("arm", begin, begin + MOVE)) is not None:
            moves[number] = later
            return True
    for number, name in enumerate(STATIONS):
        begin, end = moves[number], moves[number + 1]
        if end < begin + MOVE + LASTS[number]:
            moves[number + 1] = begin + MOVE + LASTS[number]
            return True
        if end - begin - MOVE > STAYS[number]:
            moves[number] = end - MOVE - STAYS[number]
            return True
        if (later := taken.free_from(name, begin + PICK, end + PICK)) is not None:
            moves[number] = later - PICK
            return True
    return False


# the model


@dataclass
class DayModel:
    """A screening day for CP-SAT: moves, places held from the put to the pick, waits at home."""

    plates: int
    horizon: int

    def __post_init__(self) -> None:
        self.cp = cp_model.CpModel()
        self.spans: dict[str, list[cp_model.IntervalVar]] = {name: [] for name in CAPACITY}
        self.moves = [self._plate() for _ in range(self.plates)]
        for one, other in zip(self.moves, self.moves[1:], strict=False):
            self.cp.add(one[0] <= other[0])
        for name, capacity in CAPACITY.items():
            if capacity == 1:
                self.cp.add_no_overlap(self.spans[name])
            else:
                self.cp.add_cumulative(self.spans[name], [1] * len(self.spans[name]), capacity)
        self.makespan = self.cp.new_int_var(0, self.horizon, "")
        for own in self.moves:
            self.cp.add(self.makespan >= own[-1] + MOVE)
        self.cp.minimize(self.makespan)

    def _time(self) -> cp_model.IntVar:
        return self.cp.new_int_var(0, self.horizon, "")

    def _plate(self) -> list[cp_model.IntVar]:
        moves = [self._time() for _ in range(len(STATIONS) + 1)]
        brought = [moves[0], *(self._last(begin) for begin in moves[1:-1])]
        for begin in moves:
            self.spans["arm"].append(self.cp.new_fixed_size_interval_var(begin, MOVE, ""))
        for number, name in enumerate(STATIONS):
            stay, held = moves[number + 1] - brought[number] - MOVE, self._time()
            self.cp.add(stay >= LASTS[number])
            self.cp.add(stay <= STAYS[number])
            put, picked = brought[number] + PICK, moves[number + 1] + PICK
            self.spans[name].append(self.cp.new_interval_var(put, held, picked, ""))
        return moves

    def _last(self, begin: cp_model.IntVar) -> cp_model.IntVar:
        """The move that brings a plate on: the same one, or a second one from its own place."""
        last, waits = self._time(), self.cp.new_bool_var("")
        self.cp.add(last == begin).only_enforce_if(~waits)
        self.cp.add(last >= begin + MOVE).only_enforce_if(waits)
        self.spans["arm"].append(
            self.cp.new_optional_fixed_size_interval_var(last, MOVE, waits, "")
        )
        return last

    def solved(self, seconds: float, known: Sequence[Sequence[int]] = ()) -> int:
        """The least makespan found with so much work of one worker; 0 if none was found."""
        for own, values in zip(self.moves, known, strict=False):
            for move, value in zip(own, values, strict=True):
                self.cp.add_hint(move, value)
        solver = cp_model.CpSolver()
        solver.parameters.num_workers = 1
        solver.parameters.max_deterministic_time = seconds  # about seconds of one core
        found = solver.solve(self.cp) in (cp_model.OPTIMAL, cp_model.FEASIBLE)
        return round(solver.objective_value) if found else 0


# the days


def screening(folder: Path, plates: int, most: float) -> Line:
    """A screening day beside its peers."""
    home = cell(folder, "screening", plates, (HOME_LIMIT, ""))
    initial = (
        "left(compounds, 4000000), left(stop_solution, 2000000), buffer_left(washer, 20000), "
        "waste_level(washer, 0), dispenser_box_left(dispenser, 96)"
    )
    if plates > 220:  # more than the bottles hold
        initial = initial.replace("20000", "200000").replace("000000)", "0000000)")
    line, _ = measured(
        f"screening {plates}", problem(home, "screening", plates, initial, SCREENING)
    )
    known = first_fit(plates)
    greedy = max(own[-1] + MOVE for own in known)
    seconds = min(most, line.seconds)
    peers = [DayModel(plates, greedy).solved(seconds, hint) for hint in ((), known)]
    line = Line(**{**asdict(line), "greedy": greedy, "solver": peers[0], "hinted": peers[1]})
    return Line(**{**asdict(line), "missed": "; ".join(faults(line, plates))})


def faults(line: Line, plates: int) -> Iterator[str]:
    """The bars that a screening day misses."""
    if not line.makespan or any(
        0 < peer < line.makespan for peer in (line.greedy, line.solver, line.hinted)
    ):
        yield "behind a peer"
    if plates == 40 and line.makespan > 13_200:
        yield "more than 13200"
    if plates >= 40 and line.makespan > (1 + MOST_GAP) * line.bound:
        yield "far from the bound"
    if plates == 200 and (line.seconds > MOST_S or line.peak_mb > MOST_MB):
        yield "time or memory"


def elisa(folder: Path, plates: int) -> Line:
    """An immunoassay, with bottles that suffice for all plates."""
    home = cell(
        folder,
        "elisa",
        plates,
        ("liquid_handler: {}", "liquid_handler: {trough: 4000000}"),
        ("washer: {}", "washer: {buffer: 20000, waste: 20000}"),
    )
    initial = (
        "left(conjugate, 1000000), left(substrate, 1000000), left(stop_solution, 500000), "
        "buffer_left(washer, 20000), waste_level(washer, 0), foils_left(sealer, 200), "
        "box_left(liquid_handler, 96)"
    )
    line, _ = measured(f"elisa {plates}", problem(home, "elisa", plates, initial, ELISA))
    return line if line.makespan else Line(**{**asdict(line), "missed": "no plan"})


def readers(folder: Path, plates: int) -> Line:
    """A screening day with three readers of which one is slower."""
    home = cell(folder, "screening", plates, (HOME_LIMIT, ""), READ_LONG, ("units:", READERS))
    initial = (
        "left(compounds, 4000000), left(stop_solution, 2000000), buffer_left(washer, 20000), "
        "waste_level(washer, 0), dispenser_box_left(dispenser, 96)"
    )
    line, data = measured(
        f"three readers {plates}", problem(home, "screening", plates, initial, SCREENING)
    )
    text = json.dumps(data)
    idle = [name for name in ("reader", "reader_2", "reader_3") if f"slot({name}, 1)" not in text]
    missed = f"{', '.join(idle)} not used" if idle else "" if line.makespan else "no plan"
    return Line(**{**asdict(line), "missed": missed})


def table(lines: Sequence[Line]) -> Table:
    """What was measured."""
    found = Table(
        "day", "makespan s", "bound s", "gap %", "first fit", "CP-SAT", "hinted", "cpu s", "MB", ""
    )
    for line in lines:
        gap = 100 * (line.makespan / line.bound - 1) if line.bound else float("nan")
        numbers = [line.greedy, line.solver, line.hinted]
        found.add_row(
            line.day,
            f"{line.makespan:,}",
            f"{line.bound:,}",
            f"{gap:.1f}",
            *(f"{number:,}" if number else "-" for number in numbers),
            f"{line.seconds:.1f}",
            f"{line.peak_mb:.0f}",
            line.missed,
        )
    return found


def main() -> int:
    """Measure, print, and say whether a bar was missed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--plates", type=int, nargs="*", default=[8, 23, 24, 40, 100, 200, 1000])
    parser.add_argument("--elisa", type=int, nargs="*", default=[3, 12, 48])
    parser.add_argument("--readers", type=int, nargs="*", default=[16])
    parser.add_argument("--seconds", type=float, default=120.0)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        lines = [screening(folder, plates, options.seconds) for plates in options.plates]
        lines += [elisa(folder, plates) for plates in options.elisa]
        lines += [readers(folder, plates) for plates in options.readers]
    Console(width=110).print(table(lines))
    if options.json:
        options.json.write_text(json.dumps([asdict(line) for line in lines], indent=1), "utf-8")
    return int(any(line.missed for line in lines))


if __name__ == "__main__":
    sys.exit(main())
