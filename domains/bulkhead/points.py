"""Writes `large/thousand.yaml`: a thousand points on the web of the bulkhead, for measurements of
thickness and of profile.

    python domains/bulkhead/points.py [COUNT] > domains/bulkhead/large/thousand.yaml

The points stand in a grid, between the ribs and beside the holes of `cell.yaml`, far enough from
both for the ultrasonic probe. The stations that reach them are not written: `plan --motion` and
`prepare` find them.
"""

import sys

import yaml

RIBS_X = (-0.985, -0.485, 0.485, 0.985)
RIBS_Y = (-2.485, -1.7, -0.985, -0.35, 0.35, 0.985, 1.7, 2.485)
BESIDE_RIB = 0.05
BESIDE_HOLE = 0.03
LIP = 0.1  # the lip of the flange covers this much of the outer pockets
PROFILES = 10  # every tenth point is one of profile


def points(count: int) -> list[tuple[float, float]]:
    """So many points (x, y) in metres, in the frame of the bulkhead, row by row."""
    with open(__file__.replace("points.py", "cell.yaml")) as file:
        web = yaml.safe_load(file)["fixtures"]["web"]["shapes"][0]["plate"]
    holes = [(*each["at"], each["radius"]) for each in web["holes"]]
    for step in (0.001 * n for n in range(120, 20, -1)):
        rows, columns = int(1.7 / step), int(4.7 / step)
        grid = [
            (-0.85 + step * i, -2.35 + step * j)
            for i in range(rows + 1)
            for j in range(columns + 1)
        ]
        kept = [point for point in grid if _is_open(*point, holes)]
        if len(kept) >= count:
            return kept[:count]
    raise ValueError(f"there is no room for {count} points")


def _is_open(x: float, y: float, holes: list[tuple[float, float, float]]) -> bool:
    off_ribs = (
        min(abs(x - rib) for rib in RIBS_X) > BESIDE_RIB
        and min(abs(y - rib) for rib in RIBS_Y) > BESIDE_RIB
    )
    within = abs(x) < 0.97 - LIP and abs(y) < 2.47 - LIP
    return (
        off_ribs
        and within
        and all((x - a) ** 2 + (y - b) ** 2 > (r + BESIDE_HOLE) ** 2 for a, b, r in holes)
    )


def main(count: int) -> None:
    """Print the problem file."""
    print("# yaml-language-server: $schema=../../../docs/schema/problem.schema.json")
    print(
        f"# {count} points on the web of the whole bulkhead; points.py beside cell.yaml has "
        "written this file."
    )
    print(f"problem: thousand\ndomain: bulkhead\nobjects:\n  measurement: [p1..{count}]\nstatics:")
    for number, (x, y) in enumerate(points(count), 1):
        kind = "profile" if number % PROFILES == 0 else "thickness"
        print(f"  - needs(p{number}, {kind})")
        print(f"  - position(p{number}, {round(x * 1e6)}, {round(y * 1e6)}, 0)")
        print(f"  - normal(p{number}, 0, 0, -1000)")
    print("goals:")
    for number in range(1, count + 1):
        print(f"  - measured(_, _, meas(p{number}))")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 1000)
