"""Motions of arms: paths and times for every step of a plan, poses for measurements, and images."""
