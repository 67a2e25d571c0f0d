"""`python -m engine.faces.cli` is `cellwright`."""

from engine.faces.cli import main

main()
