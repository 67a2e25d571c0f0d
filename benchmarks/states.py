"""Contact states of THEMSE with more and more probes, drawer and freezer with as many depots: how
net and count grow.

python benchmarks/states.py [PROBES ...]

With eight and with sixteen probes, the net by contact class must stay under 40 places and take less
than a second of processor time, and the count of fully specified states must be exact. Otherwise it
exits with 1.
"""

import json
import sys
import time
import tracemalloc
from dataclasses import replace
from pathlib import Path

from cellwright.engine.pipelines import contact_states
from cellwright.kb.model.contact_model import ContactModel, Octuple, Quadruple

KEPT = Path("build/benchmarks/states.json")
MOST_PLACES, MOST_SECONDS, JUDGED = 40, 1.0, (8, 16)


def themse(probes: int) -> ContactModel:
    """THEMSE with this many probes, and as many depots in the drawer and in the freezer."""
    model, _ = contact_states.contact_model_of("themse")
    classes = dict(model.classes)
    for name in ("THEMSE_drawer", "THEMSE_freezer"):
        anchors = classes[name].anchors
        depot = next(each for each in anchors.values() if each.anchor_class == "probe_depot")
        kept = {key: each for key, each in anchors.items() if each.anchor_class != "probe_depot"}
        depots = {f"depot_{n}": replace(depot, name=f"depot_{n}") for n in range(1, probes + 1)}
        classes[name] = replace(classes[name], anchors=kept | depots)
    objects = {name: kind for name, kind in model.objects.items() if kind != "probe"}
    objects |= {f"probe_{n}": "probe" for n in range(1, probes + 1)}
    others = tuple(each for each in model.initial if each.first.object_class != "probe")
    return replace(
        model,
        classes=classes,
        objects=objects,
        initial=(*others, *(_seated(n) for n in range(1, probes + 1))),
        meanings=(),
        filters=("stability", "templates"),  # the cell has a geometry for four probes
    )


def _seated(number: int) -> Octuple:
    return Octuple(
        Quadruple("probe", f"probe_{number}", "probe_base", "base"),
        Quadruple("THEMSE_drawer", "drawer", "probe_depot", f"depot_{number}"),
    )


def measured(probes: int) -> dict[str, object]:
    """Places, transitions, states, seconds of processor time and the most memory in megabytes."""
    model = themse(probes)
    started = time.process_time()
    net = contact_states.build_net(model)
    seconds = time.process_time() - started
    tracemalloc.start()
    contact_states.build_net(model)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return {
        "probes": probes,
        "places": len(net.places),
        "transitions": len(net.transitions),
        "classes": net.growth.classes,
        "states": net.growth.states,
        "exact": net.growth.exact,
        "seconds": round(seconds, 3),
        "megabytes": round(peak / 2**20, 1),
    }


def main(counts: list[int]) -> int:
    """Print a line for each number of probes and keep them as JSON.

    Returns 1 if a bound is missed.
    """
    print(
        f"{'probes':>6} {'places':>6} {'steps':>6} {'classes':>8} {'s':>7} {'MB':>6}  fully "
        "specified states"
    )
    rows, missed = [], 0
    for probes in counts:
        row = measured(probes)
        rows.append(row)
        exact = "" if row["exact"] else "at most "
        print(
            f"{probes:6} {row['places']:6} {row['transitions']:6} {row['classes']!s:>8} "
            f"{row['seconds']:7.3f}"
            f" {row['megabytes']:6.1f}  {exact}{row['states']:,}"
        )
        good = len(str(row["places"])) < 3 and int(str(row["places"])) < MOST_PLACES
        quick = float(str(row["seconds"])) < MOST_SECONDS and bool(row["exact"])
        missed |= probes in JUDGED and not (good and quick)
    KEPT.parent.mkdir(parents=True, exist_ok=True)
    KEPT.write_text(json.dumps(rows, indent=1) + "\n")
    return int(missed)


if __name__ == "__main__":
    sys.exit(main([int(each) for each in sys.argv[1:]] or [1, 2, 4, 8, 16]))
