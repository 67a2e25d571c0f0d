"""Test selection, several faults, fault bases and learning, measured against the bars that they
have to meet.

    python benchmarks/diagnosis.py [--data FOLDER] [--problems N] [--part NAME ...] [--json FILE]

FOLDER (or the environment variable CELLWRIGHT_DATA) has `iscas85/*.bench`. Parts: exact, sparse,
noisy, unsure, setup, circuits, multiplier, advice, bases, learning. Times are of one process with
compiled kernels warmed up. Exits with 1 when a bar is missed: exact under 1 s at 20 x 20 and 10 s
at 30 x 30; rollout within 0.5 % of the optimum in the mean and 5 % at worst, no bound violated;
unsure tests without loss up to 8, within 1 % up to 12, and 20 of them within 5 % of the bound and
in 2 s; circuits under 5 s each, c6288 no slower than the plain model; first advice in 2 s; every
cause isolated, at a mean cost that is the optimum but for chance; learned trees within 2 % after
500 cases.
"""

import argparse
import json
import math
import os
import random
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from belief_program import least_cost
from rich.console import Console
from rich.table import Table
from troubles import isolation, uncertain, unsure, with_setup

from benchmarks.circuit_diagnosis import (
    diagnose_circuit,
    diagnosis_program,
    read_bench,
)
from cellwright.engine.model.troubleshooting import (
    Action,
    CaseAdvice,
    CaseHypothesis,
    Circuit,
    Troubleshooting,
    expected_cost,
)
from cellwright.engine.stages.diagnosis.action_selection import ActionSelector
from cellwright.engine.stages.diagnosis.case_session import QUESTION, CaseSession, run_session
from cellwright.engine.stages.diagnosis.fault_problems import open_case
from cellwright.engine.stages.diagnosis.hidden_cause import HiddenWorld, cost_under, draw_cause
from cellwright.kb.asp.model_search import best_models
from cellwright.kb.loader import bundled_domains
from cellwright.kb.loader.fault_base import load_faults
from cellwright.kb.model.fault_model import FaultModel

Row = dict[str, Any]
PLENTY = 10_000_000
CIRCUITS = ("c17", "c432", "c499", "c880", "c1355", "c2670", "c7552")


def exact(problems: int, _: Path) -> tuple[list[Row], list[str]]:
    """Time to the proven optimum and the whole tree, deterministic outcomes."""
    rows, missed = [], []
    for size, bar in ((20, 1.0), (30, 10.0)):
        for density in (0.5, 0.3, 0.12):
            for skewed in (False, True):
                times = [
                    _solved(isolation(size, size, density, skewed, seed))
                    for seed in range(max(1, problems // 10))
                ]
                rows.append(
                    {
                        "causes x tests": f"{size} x {size}",
                        "density": density,
                        "priors": "skewed" if skewed else "flat",
                        "mean (s)": statistics.mean(times),
                        "worst (s)": max(times),
                    }
                )
                missed += (
                    [f"exact at {size} x {size}: {max(times):.2f} s"] if max(times) > bar else []
                )
    return rows, missed


def _solved(problem: Troubleshooting) -> float:
    started = time.perf_counter()
    selector = ActionSelector(problem, PLENTY)
    advice = selector.advise(selector.start())
    cost = expected_cost(selector.tree())
    assert advice.optimal
    assert abs(cost - advice.expected_cost) < 1e-6
    return time.perf_counter() - started


def sparse(problems: int, _: Path) -> tuple[list[Row], list[str]]:
    """Rollout and rules against the optimum where each cause shows in few tests."""
    return _against(
        "30 x 30 sparse", lambda seed: isolation(30, 30, 0.12, bool(seed % 2), seed), problems
    )


def noisy(problems: int, _: Path) -> tuple[list[Row], list[str]]:
    """Rollout and rules against the optimum where every outcome is uncertain."""
    return _against("12 x 12 uncertain", lambda seed: uncertain(12, 12, seed), problems)


def _against(
    name: str, make: Callable[[int], Troubleshooting], problems: int
) -> tuple[list[Row], list[str]]:
    losses: dict[str, list[float]] = {"rollout": [], "gain per cost": [], "pairs per cost": []}
    violated = 0
    for seed in range(problems):
        optimum, costs, bounds = _compared(make(seed))
        violated += any(bound > optimum * (1 + 1e-9) for bound in bounds)
        for rule, cost in costs.items():
            losses[rule].append(100 * (cost / optimum - 1))
    rows = [
        {
            "problems": name,
            "rule": rule,
            "mean loss (%)": statistics.mean(lost),
            "worst (%)": max(lost),
        }
        for rule, lost in losses.items()
    ]
    mean, worst = statistics.mean(losses["rollout"]), max(losses["rollout"])
    missed = (
        [f"{name}: rollout loses {mean:.2f} %, {worst:.2f} %"] if mean > 0.5 or worst > 5 else []
    )
    return rows, missed + ([f"{name}: {violated} bounds violated"] if violated else [])


def _compared(problem: Troubleshooting) -> tuple[float, dict[str, float], list[float]]:
    """The optimum, the costs of rollout and rules, and the bounds that were printed with small
    budgets.
    """
    selector = ActionSelector(problem, PLENTY)
    best = selector.advise(selector.start())
    assert best.optimal
    hasty = ActionSelector(problem, 1)
    costs = {
        "rollout": expected_cost(hasty.tree()),
        "gain per cost": expected_cost(selector.tree(choose=selector.rule("gain"))),
        "pairs per cost": expected_cost(selector.tree(choose=selector.rule("pairs"))),
    }
    thrifty = ActionSelector(problem, 100)
    bounds = [each.advise(each.start()).bound for each in (hasty, thrifty)]
    return best.expected_cost, costs, bounds


def setup(problems: int, _: Path) -> tuple[list[Row], list[str]]:
    """With set-up costs: rollout and rules, and choosing tests as if their preconditions cost
    nothing.
    """
    lost = []
    for seed in range(problems):
        problem = with_setup(10, 10, 3, seed)
        blind = Troubleshooting(
            problem.causes, problem.priors, problem.actions, problem.conclusions
        )
        selector = ActionSelector(problem, PLENTY)
        optimum = selector.advise(selector.start()).expected_cost
        lost.append(100 * (cost_under(problem, ActionSelector(blind, PLENTY).tree()) / optimum - 1))
    rows, missed = _against(
        "10 x 10 with set-up", lambda seed: with_setup(10, 10, 3, seed), problems
    )
    ignored = {"problems": rows[0]["problems"], "rule": "optimal without set-up"}
    return [
        *rows,
        {**ignored, "mean loss (%)": statistics.mean(lost), "worst (%)": max(lost)},
    ], missed


def unsure_tests(problems: int, _: Path) -> tuple[list[Row], list[str]]:
    """Unsure tests and repairs: the tree against a dynamic program over beliefs, and the gap
    where there is none.
    """
    rows, missed = list[Row](), list[str]()
    for sizes, bar in (((4, 5, 6, 7, 8), 1e-7), ((9, 10, 11, 12), 1.0)):
        losses, wrong, times = [], 0, []
        for seed in range(3 * problems // 4):
            problem = unsure(3 + seed % 2, sizes[seed % len(sizes)], seed)
            started = time.perf_counter()
            selector = ActionSelector(problem)
            found = selector.advise(selector.start())
            times.append(time.perf_counter() - started)
            optimum = least_cost(problem)
            losses.append(100 * (expected_cost(selector.tree()) / optimum - 1))
            wrong += found.bound > optimum * (1 + 1e-9)
        row = {
            "tests": f"{sizes[0]} to {sizes[-1]}",
            "problems": len(losses),
            "mean loss or gap (%)": statistics.mean(losses),
        }
        rows.append(
            row
            | {
                "worst (%)": max(losses),
                "mean advice (s)": statistics.mean(times),
                "worst advice (s)": max(times),
            }
        )
        missed += [f"unsure tests, {sizes}: loss {max(losses):.3f} %"] if max(losses) > bar else []
        missed += [f"unsure tests, {sizes}: {wrong} bounds violated"] if wrong else []
    for causes in (3, 4, 6, 8):
        gaps, times = [], []
        for seed in range(max(3, problems // 10)):
            problem = unsure(causes, 20, seed)
            started = time.perf_counter()
            selector = ActionSelector(problem)
            found = selector.advise(selector.start())
            times.append(time.perf_counter() - started)
            gaps.append(100 * (found.expected_cost / found.bound - 1))
        row = {
            "tests": f"20, {causes} causes",
            "problems": len(gaps),
            "mean loss or gap (%)": statistics.mean(gaps),
        }
        rows.append(
            row
            | {
                "worst (%)": max(gaps),
                "mean advice (s)": statistics.mean(times),
                "worst advice (s)": max(times),
            }
        )
        missed += (
            [f"20 unsure tests, {causes} causes: {max(gaps):.2f} % above the bound"]
            if max(gaps) > 5
            else []
        )
        missed += (
            [f"20 unsure tests, {causes} causes: {max(times):.2f} s"] if max(times) > 2 else []
        )
    return rows, missed


def circuits(problems: int, data: Path) -> tuple[list[Row], list[str]]:
    """Minimum-cardinality diagnoses of circuits with one to five inverted gates, grounding
    included.
    """
    rows, missed = [], []
    for name in CIRCUITS:
        file = data / "iscas85" / f"{name}.bench"
        if not file.exists():
            missed.append(f"{file} is not there")
            continue
        circuit = read_bench(file.read_text(), name)
        found = [
            _inverted(circuit, count, seed)
            for seed in range(max(1, problems // 50))
            for count in range(1, 6)
        ]
        times = [seconds for seconds, _ in found]
        rows.append(
            {
                "circuit": name,
                "gates": len(circuit.gates),
                "mean (s)": statistics.mean(times),
                "worst (s)": max(times),
                "largest diagnosis": max(size for _, size in found),
            }
        )
        missed += [f"{name}: {max(times):.2f} s"] if max(times) > 5 else []
    return rows, missed


def _inverted(circuit: Circuit, count: int, seed: int) -> tuple[float, int]:
    """Seconds and size of the diagnosis of a circuit with so many inverted gates."""
    given, seen = drawn(circuit, count, seed)
    started = time.perf_counter()
    made = diagnose_circuit(circuit, given, seen)
    taken = time.perf_counter() - started
    assert made is not None
    assert len(made.gates) <= count
    explained = circuit.values(given, frozenset(made.gates))
    assert all(explained[output] == value for output, value in seen.items())
    return taken, len(made.gates)


def drawn(circuit: Circuit, count: int, seed: int) -> tuple[dict[str, bool], dict[str, bool]]:
    """Inputs, and the outputs of a circuit with so many inverted gates that show at the outputs."""
    chance, shows = random.Random(100 * seed + count), False
    while not shows:
        given = {wire: chance.random() < 0.5 for wire in circuit.inputs}
        inverted = frozenset(chance.sample(list(circuit.gates), count))
        values, nominal = circuit.values(given, inverted), circuit.values(given)
        shows = any(values[output] != nominal[output] for output in circuit.outputs)
    return given, {output: values[output] for output in circuit.outputs}


def multiplier(problems: int, data: Path) -> tuple[list[Row], list[str]]:
    """c6288 with five inversions, beside the plain model: every gate may be faulty, and clingo
    searches by cores.
    """
    file, rows, missed = data / "iscas85" / "c6288.bench", list[Row](), list[str]()
    if not file.exists():
        return [], [f"{file} is not there"]
    circuit = read_bench(file.read_text(), "c6288")
    for seed in range(max(1, problems // 100)):
        given, seen = drawn(circuit, 5, seed)
        started = time.perf_counter()
        made = diagnose_circuit(circuit, given, seen)
        ours = time.perf_counter() - started
        text = diagnosis_program(circuit, given, seen, frozenset(circuit.gates))
        plain = next(iter(best_models(text, "faulty", 1, ("--opt-strategy=usc",))))
        taken = time.perf_counter() - started - ours
        assert made is not None
        assert len(made.gates) == len(plain[1])
        rows.append(
            {
                "circuit": "c6288",
                "seed": seed,
                "gates": len(made.gates),
                "ours (s)": ours,
                "plain (s)": taken,
            }
        )
        missed += [f"c6288, seed {seed}: {ours:.2f} s, plain {taken:.2f} s"] if ours > taken else []
    return rows, missed


def advice(problems: int, _: Path) -> tuple[list[Row], list[str]]:
    """The first advice of large problems with the default budget: how long it takes, and how
    far its bound is.
    """
    rows, missed = list[Row](), list[str]()
    for size, density in ((60, 0.12), (100, 0.12), (200, 0.12), (500, 0.12), (500, 0.02)):
        for seed in range(max(1, problems // 100)):
            problem = isolation(size, size, density, bool(seed % 2), seed)
            started = time.perf_counter()
            selector = ActionSelector(problem)
            found = selector.advise(selector.start())
            taken = time.perf_counter() - started
            row = {
                "causes x tests": f"{size} x {size}",
                "density": density,
                "seed": seed,
                "time (s)": taken,
            }
            rows.append(row | {"cost": found.expected_cost, "bound": found.bound})
            missed += [f"first advice at {size} x {size}: {taken:.2f} s"] if taken > 2 else []
    return rows, missed


def models() -> dict[str, FaultModel]:
    """The bundled fault bases."""
    return {
        name: load_faults(folder / "domain.yaml")[0] for name, folder in bundled_domains().items()
    }


def bases(problems: int, _: Path) -> tuple[list[Row], list[str]]:
    """Every cause of every exception hidden in turn: is it isolated, and at which mean cost."""
    rows, missed = [], []
    for domain, model in models().items():
        for exception in model.exceptions:
            problem = open_case(model, exception).problem
            optimum = expected_cost(ActionSelector(problem).tree())
            mean, variance, wrong = 0.0, 0.0, []
            for cause, prior in model.priors(exception).items():
                costs = []
                for seed in range(max(20, problems // 5)):
                    world = HiddenWorld(
                        model, CaseHypothesis((cause,)), random.Random(f"{cause} {seed}")
                    )
                    made = run_session(CaseSession(model, exception), _tests_of(world))
                    costs.append(made.cost)
                    wrong += (
                        [cause]
                        if made.hypotheses[0][0].causes != (cause,) or not made.isolated
                        else []
                    )
                mean += prior * statistics.mean(costs)
                variance += prior**2 * statistics.variance(costs) / len(costs)
            rows.append(
                {
                    "exception": f"{domain}: {exception}",
                    "causes": len(problem.causes),
                    "tests": len(problem.actions),
                    "mean cost": mean,
                    "error": math.sqrt(variance),
                    "optimum": optimum,
                }
            )
            missed += [f"{exception}: {cause} is not isolated" for cause in dict.fromkeys(wrong)]
            off = abs(mean - optimum) > 0.01 * optimum + 3 * math.sqrt(variance)
            missed += [f"{exception}: mean {mean:.2f}, optimum {optimum:.2f}"] if off else []
    return rows, missed


def _tests_of(world: HiddenWorld) -> Callable[[Action, CaseAdvice], str | None]:
    """The answers of a world; nobody answers the question of a safe stop, which no test plan
    pays for.
    """
    return lambda action, _: None if action.name == QUESTION else world.respond(action)


def learning(problems: int, _: Path, cases: int = 500) -> tuple[list[Row], list[str]]:
    """Counts learned from nothing in 500 cases: the tree they give, priced with the true
    frequencies.
    """
    rows, missed = [], []
    for domain, model in models().items():
        before, after = [], []
        for exception in model.exceptions:
            true = open_case(model, exception).problem
            optimum = expected_cost(ActionSelector(true).tree())
            flat = ActionSelector(open_case(model, exception, counts={}).problem).tree()
            before.append(100 * (cost_under(true, flat) / optimum - 1))
            after += [
                100 * (cost_under(true, _learned(model, exception, cases, seed)) / optimum - 1)
                for seed in range(max(5, problems // 4))
            ]
        mean = statistics.mean(after)
        rows.append(
            {
                "domain": domain,
                "loss at first (%)": statistics.mean(before),
                f"after {cases} cases (%)": mean,
            }
        )
        missed += [f"{domain}: learned trees lose {mean:.2f} %"] if mean > 2 else []
    return rows, missed


def _learned(model: FaultModel, exception: str, cases: int, seed: int) -> Any:
    chance, counts = random.Random(seed), dict.fromkeys(model.exceptions[exception].counts, 0.0)
    for _ in range(cases):
        counts[draw_cause(model, exception, chance).causes[0]] += 1
    return ActionSelector(open_case(model, exception, counts=counts).problem).tree()


PARTS = {
    "exact": exact,
    "sparse": sparse,
    "noisy": noisy,
    "unsure": unsure_tests,
    "setup": setup,
    "circuits": circuits,
    "multiplier": multiplier,
    "advice": advice,
    "bases": bases,
    "learning": learning,
}


def table(name: str, rows: list[Row]) -> Table:
    """The rows for people."""
    made = Table(title=name, box=None, pad_edge=False, title_justify="left")
    for key in rows[0] if rows else ():
        made.add_column(key, justify="right")
    for row in rows:
        made.add_row(
            *(f"{value:.3f}" if isinstance(value, float) else str(value) for value in row.values())
        )
    return made


def main() -> int:
    """Measure, print, keep."""
    parser = argparse.ArgumentParser(description="measure diagnosis")
    parser.add_argument(
        "--data", type=Path, default=Path(os.environ.get("CELLWRIGHT_DATA", "../shared/data"))
    )
    parser.add_argument("--problems", type=int, default=200)
    parser.add_argument("--part", nargs="+", choices=PARTS, default=list(PARTS))
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    console = Console(width=None if sys.stdout.isatty() else 120)
    for make in (isolation(4, 4, 0.5, False, 0), uncertain(4, 4, 0), uncertain(8, 2, 1)):
        _compared(make)  # compile
    kept, missed = {}, []
    for part in arguments.part:
        rows, found = PARTS[part](arguments.problems, arguments.data)
        kept[part], missed = rows, missed + found
        console.print(table(part, rows), "")
    for line in missed:
        console.print(f"missed: {line}")
    if arguments.json:
        arguments.json.write_text(json.dumps({**kept, "missed": missed}, indent=1) + "\n")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
