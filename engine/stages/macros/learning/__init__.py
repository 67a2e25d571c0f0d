"""From a plan to a MACROP: why it works, and for what else."""
