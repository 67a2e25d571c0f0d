"""Motions of arms: paths and times for every step of a plan, poses for measurements, and images."""

from cellwright.engine.pipelines.motion.plan_walk import PlanWalk

__all__ = ["PlanWalk"]
