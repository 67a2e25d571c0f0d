"""unified-planning: its problems as ours, our plans as its own, and the engine that it calls."""
