"""What other planning systems read and write, joined with the stages: PDDL exports and the engine for unified-planning."""
