"""Learning of a MACROP from a plan: a proof why the plan works, generalised."""
