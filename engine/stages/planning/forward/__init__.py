"""Forward search: from the initial state, led by relaxed plans and landmarks."""
