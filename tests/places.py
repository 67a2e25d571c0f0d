"""Where things are, for tests of every folder."""

from pathlib import Path

TOP = Path(__file__).parents[1]
BUNDLED = TOP / "domains"
DOMAINS = TOP / "tests" / "domains"
