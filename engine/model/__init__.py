"""What the stages of the engine pass to each other: ground tasks and outcomes, all immutable."""
