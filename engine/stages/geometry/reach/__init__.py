"""Which places an arm reaches, and why not the others."""
