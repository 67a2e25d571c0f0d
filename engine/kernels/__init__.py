"""Compiled loops over arrays that several stages share. They know no types of ours."""
