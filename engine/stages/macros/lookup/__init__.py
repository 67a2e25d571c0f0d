"""From a problem to a MACROP that serves it."""
