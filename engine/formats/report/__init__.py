"""Answers for people and programs: text, JSON, DOT, SVG."""
