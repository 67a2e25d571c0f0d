"""Random small PDDL tasks beside a brute force over the definition of the language: wrong plans,
false proofs, wrong verdicts.

    python -m benchmarks.pddl_definition [--tasks 400] [--first 0] [--numeric-axioms]

Exits with 1 if there is any difference, after having printed the tasks.
"""

import argparse
import sys
from collections import Counter
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.properties.pddl_agreement import compared
from tests.properties.pddl_tasks import random_task


def main() -> None:
    """Compare and print the counts."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--tasks", type=int, default=400)
    options.add_argument("--first", type=int, default=0, help="the seed of the first task")
    options.add_argument("--numeric-axioms", action="store_true", help="axioms compare numbers")
    chosen = options.parse_args()
    counts: Counter[str] = Counter()
    judged = wrong = 0
    with TemporaryDirectory() as folder:
        for seed in range(chosen.first, chosen.first + chosen.tasks):
            domain, problem = random_task(seed, chosen.numeric_axioms)
            found = compared(domain, problem, Path(folder), seed)
            counts[f"{found.outcome}{', brute force certain' if found.certain else ''}"] += 1
            counts["plans with steps"] += found.steps > 0
            judged += found.judged
            wrong += bool(found.differences)
            for each in found.differences:
                print(f"task {seed}: {each}\n{domain}\n{problem}")
    for name, count in sorted(counts.items()):
        print(f"{count:6} {name}")
    print(f"{judged:6} plans judged by both\n{wrong:6} tasks with a difference")
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
