"""What measured values mean together: where the part lies, which values are bad, what each feature shows, what is worth repeating."""
