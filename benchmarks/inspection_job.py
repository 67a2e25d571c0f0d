"""A whole inspection in simulation whose truth is known: the bulkhead with its datums, both tools,
bad values and a broken probe.

The points are those of `bulkhead/thousand`, a quarter of them profiles; 20 datums on three sides of
the part, two of them bad. The part is displaced by up to 30 mm and 5 degrees. Thicknesses and
surfaces vary smoothly over the part, so that about a tenth of the points is near a limit or beyond
it, and five points have real dents. Two percent of the first values are wrong by 6 to 40 standard
deviations. The probe breaks at its 400th measurement, or in the middle of a smaller job. Everything
is done by the commands `run` and `results`, and read from what they write.
"""

import json
import math
import random
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cellwright.kb.loader import bundled_domains, load

SIGMA = {"us_probe": 8.0, "slra": 50.0}  # micrometres
THICK_UM, ZONES = 6350, {"thickness": 200, "profile": 1000}
WAVES = {"thickness": 60.0, "profile": 290.0}
DATUMS, BAD, DENTS, RISK = 20, 0.02, 5, 5
DENT = 12.0  # standard deviations


@dataclass(frozen=True)
class Job:
    """A problem file, the truth behind it, and the limits of each point."""

    problem: str
    truth: dict[str, Any]
    zones: Mapping[str, tuple[float, float]]
    tools: Mapping[str, str]


def places(count: int) -> list[tuple[int, int, int]]:
    """The positions of some points of the bundled problem, spread over the whole part."""
    thousand = load(bundled_domains()["bulkhead"] / "large" / "thousand.yaml").problem
    assert thousand is not None
    found = [f.arguments[1:] for f in thousand.statics if f.name == "position"]
    each = [(int(str(x)), int(str(y)), int(str(z))) for x, y, z in found]
    return [each[n * len(each) // count] for n in range(count)]


def job(count: int, seed: int) -> Job:
    """A job of `count` points, datums among them."""
    chance = random.Random(seed)
    points = places(count - DATUMS)
    lines, truth = list[str](), _displacement(chance)
    zones, tools = dict[str, tuple[float, float]](), dict[str, str]()
    dents = set(chance.sample(range(len(points)), min(DENTS, len(points))))
    for number, (x, y, z) in enumerate(points):
        name, kind = f"p{number + 1}", "profile" if number % 4 == 0 else "thickness"
        tool, nominal = ("slra", 0) if kind == "profile" else ("us_probe", THICK_UM)
        lines += [
            f"needs({name}, {kind})",
            f"position({name}, {x}, {y}, {z})",
            f"normal({name}, 0, 0, -1000)",
        ]
        lines += [f"nominal({name}, {nominal})", f"tolerance({name}, {ZONES[kind]})"]
        wave = math.sin(1.3e-6 * y + seed) + 0.7 * math.cos(2e-6 * x)
        dent = DENT * SIGMA[tool] * (number in dents)
        truth["values"][name] = nominal + WAVES[kind] * wave - dent
        zones[name], tools[name] = (nominal - ZONES[kind] / 2, nominal + ZONES[kind] / 2), tool
        if number not in dents and chance.random() < BAD:
            truth["bad"][name] = chance.choice([-1, 1]) * chance.uniform(6, 40) * SIGMA[tool]
    lines += _datums(chance, truth)
    names = [*(f"d{n}" for n in range(1, DATUMS + 1)), *(f"p{n + 1}" for n in range(len(points)))]
    facts = [*lines, *(f"uncertainty({tool}, {round(2 * sigma)})" for tool, sigma in SIGMA.items())]
    text = [
        "problem: job",
        "domain: bulkhead",
        "objects:",
        f"  measurement: [{', '.join(names)}]",
        "statics:",
    ]
    text += [
        *(f"  - {fact}" for fact in facts),
        "goals:",
        *(f"  - measured(_, _, meas({name}))" for name in names),
    ]
    return Job("\n".join([*text, ""]), truth, zones, tools)


def _displacement(chance: random.Random) -> dict[str, Any]:
    def vector(longest: float) -> list[float]:
        v = [chance.gauss(0, 1) for _ in range(3)]
        return [each * chance.uniform(0, longest) / math.hypot(*v) for each in v]

    return {"shift_mm": vector(30), "turn_deg": vector(5), "values": {}, "noise": SIGMA, "bad": {}}


def _datums(chance: random.Random, truth: dict[str, Any]) -> list[str]:
    lines = list[str]()
    for number in range(1, DATUMS + 1):
        at = [round(chance.uniform(-b, b)) for b in (950_000, 2_450_000, 80_000)]
        normal = [-1000 if axis == number % 3 else 0 for axis in range(3)]
        lines += [f"needs(d{number}, profile)", f"alignment(d{number}, 1)"]
        lines += [
            f"position(d{number}, {', '.join(map(str, at))})",
            f"normal(d{number}, {', '.join(map(str, normal))})",
        ]
    for number in chance.sample(range(1, DATUMS + 1), 2):
        truth["bad"][f"d{number}"] = chance.choice([-1, 1]) * chance.uniform(1000, 20_000)
    return lines


def cellwright(*words: str) -> subprocess.CompletedProcess[str]:
    """A command of the command line, in a process of its own."""
    return subprocess.run(
        [sys.executable, "-m", "cellwright.engine.faces.cli", *words],
        capture_output=True,
        text=True,
        check=False,
    )


def carried_out(count: int, seed: int, folder: Path, xsd: Path | None) -> dict[str, Any]:
    """Run one job, and judge what came of it by the truth."""
    made = job(count, seed)
    problem, truth, store = folder / "job.yaml", folder / "truth.json", folder / f"runs_{seed}.db"
    problem.write_text(made.problem)
    truth.write_text(json.dumps(made.truth))
    began = time.perf_counter()
    breaks = min(400, count // 3)
    said = cellwright(
        "run", str(problem), "--option", f"truth={truth}", "--fault", f"us_measure#{breaks}=broken_probe@no_echo",
        "--store", str(store), "--name", "job", "--seed", str(seed), "--format", "json",
    )  # fmt: skip
    told = cellwright("results", "job", "--store", str(store), "--format", "json")
    if not told.stdout:
        return {"seed": seed, "failed": said.stdout[-500:] + said.stderr[-500:]}
    answer, survey = json.loads(said.stdout)["data"], json.loads(told.stdout)["data"]["survey"]
    found = judged(made, survey)
    found |= {
        "seed": seed,
        "points": count,
        "outcome": json.loads(said.stdout)["status"],
        "exceptions": answer.get("exceptions"),
    }
    found |= {
        "hours": round(answer.get("makespan_ms", 0) / 3.6e6, 2),
        "wall_s": round(time.perf_counter() - began, 1),
    }
    return found | ({"qif": qif_valid(store, folder, xsd)} if xsd else {})


def judged(made: Job, survey: Mapping[str, Any]) -> dict[str, Any]:
    """What a survey says beside the truth.

    Shares are of the features that were decided, and of all with limits.
    """
    features = {each["of"]: each for each in survey["features"]}
    bad = [name for name, off in made.truth["bad"].items()]
    missed = [name for name in bad if not features.get(name, {}).get("bad")]
    lost = [each["name"] for each in survey["not_measured"]]
    lost += [
        each["of"] for each in features.values() if each["verdict"] in ("doubtful", "not measured")
    ]
    wrong, decided, undecided = [], 0, 0
    for name, (low, high) in made.zones.items():
        verdict = features[name]["verdict"] if name in features else ""
        inside = low <= made.truth["values"][name] <= high
        decided += verdict in ("conforming", "not conforming")
        undecided += verdict == "undecided"
        wrong += [name] if verdict == ("not conforming" if inside else "conforming") else []
    called_bad = [each["of"] for each in features.values() if each["verdict"] == "not conforming"]
    return {
        "bad": len(bad), "missed": missed, "lost": lost, "decided": decided, "wrong": wrong,
        "wrong share": round(len(wrong) / max(1, decided), 4), "not conforming": len(called_bad),
        "undecided share": round(undecided / max(1, len(made.zones)), 4),
        "good values left "
        "out": sum(len(e["bad"]) for n, e in features.items() if n not in made.truth["bad"]),
        "within stated uncertainty": within(made, features),
    }  # fmt: skip


def within(made: Job, features: Mapping[str, Any]) -> float:
    """The share of features whose value is within its expanded uncertainty of the truth; 95 %
    if that is what it says.
    """
    near = [
        abs(features[name]["value"] - made.truth["values"][name]) <= features[name]["uncertainty"]
        for name in made.zones
        if name in features and features[name]["value"] is not None
    ]
    return round(sum(near) / max(1, len(near)), 4)


def qif_valid(store: Path, folder: Path, xsd: Path) -> str:
    """Whether the results as QIF are valid by the schema, and read back equal to those as JSON."""
    import xmlschema

    from cellwright.engine.formats.interop.results import ResultForm, read_results_text

    for form in ("qif", "json"):
        cellwright("results", "job", "--store", str(store), "-o", str(folder / f"job.{form}"))
    xmlschema.XMLSchema(str(xsd)).validate(str(folder / "job.qif"))
    texts = ((folder / f"job.{form}").read_text() for form in ("qif", "json"))
    one, other = (
        read_results_text(text, form).measured
        for text, form in zip(texts, (ResultForm.QIF, ResultForm.JSON), strict=True)
    )
    return "valid, read back equal" if one == other else "valid, but not read back equal"


def missed(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """The bars that are missed."""
    said = []
    for row in rows:
        if "failed" in row:
            said.append(f"seed {row['seed']}: no results: {row['failed']}")
            continue
        if row["missed"]:
            said.append(
                f"seed {row['seed']}: bad values of {', '.join(row['missed'])} were not caught"
            )
        if row["lost"]:
            said.append(
                f"seed {row['seed']}: {len(row['lost'])} measurements are lost, such as "
                f"{row['lost'][0]}"
            )
        if row["wrong share"] > RISK / 100:
            said.append(f"seed {row['seed']}: {row['wrong share']:.1%} of the decisions are wrong")
        if row.get("qif", "valid, read back equal") != "valid, read back equal":
            said.append(f"seed {row['seed']}: QIF is {row['qif']}")
    return said
