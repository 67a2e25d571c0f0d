"""Other formats and systems: PDDL, QIF, TSPLIB, job shops, S-LAB tables and unified-planning."""
