"""What was planned, carried out by physics (the extra `mujoco`): jaws that close, parts that slip, and looks at what has become of it."""
