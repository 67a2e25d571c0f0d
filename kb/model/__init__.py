"""What a person can write in a file, or we can read back later: domains, problems, plans."""
