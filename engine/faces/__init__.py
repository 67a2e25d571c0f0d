"""The interfaces through which people and other programs call the engine."""
