"""Golden plans: a domain's problems are planned again and compared with the answers that were once accepted."""
