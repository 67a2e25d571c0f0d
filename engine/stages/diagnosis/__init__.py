"""The exception handler: which test next, what caused it, what puts it right."""
