"""Compiled loops over arrays that several stages share; they import nothing above them."""
