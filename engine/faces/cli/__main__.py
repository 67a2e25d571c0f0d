"""`python -m cellwright.engine.faces.cli` is `cellwright`."""

from cellwright.engine.faces.cli import main

main()
