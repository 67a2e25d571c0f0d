"""Forward search from the initial state, guided by relaxed plans and landmarks."""
