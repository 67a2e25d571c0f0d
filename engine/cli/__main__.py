"""`python -m engine.cli` is `cellwright`."""

from engine.cli import main

main()
