"""Which places an arm reaches, and why it does not reach the others."""
