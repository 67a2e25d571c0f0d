"""Other formats and systems: PDDL in and out."""
