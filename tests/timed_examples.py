"""Small tasks with times, in the style of matches and fuses, of robots of PlanSys2 and ROSPlan,
and of windows.
"""

from pathlib import Path

from cellwright.engine.formats.interop.pddl.durative import TemporalTask, read_temporal

CELLAR = """
(define (domain cellar)
  (:requirements :typing :durative-actions)
  (:types match fuse)
  (:predicates (handfree) (unused ?m - match) (light ?m - match) (mended ?f - fuse))
  (:durative-action strike :parameters (?m - match) :duration (= ?duration 5)
    :condition (at start (unused ?m))
    :effect (and (at start (not (unused ?m))) (at start (light ?m)) (at end (not (light ?m)))))
  (:durative-action mend :parameters (?f - fuse ?m - match) :duration (= ?duration 2)
    :condition (and (at start (handfree)) (over all (light ?m)))
    :effect (and (at start (not (handfree))) (at end (mended ?f)) (at end (handfree)))))
"""
FUSES = """
(define (problem fuses) (:domain cellar)
  (:objects m1 m2 - match f1 f2 f3 - fuse)
  (:init (handfree) (unused m1) (unused m2))
  (:goal (and (mended f1) (mended f2) (mended f3))) (:metric minimize (total-time)))
"""
PATROL = """
(define (domain patrol)
  (:requirements :strips :typing :durative-actions :fluents)
  (:types robot waypoint)
  (:predicates (robot_at ?r - robot ?w - waypoint) (connected ?a ?b - waypoint) (charging_at ?w - waypoint)
    (free ?r - robot) (patrolled ?w - waypoint))
  (:functions (battery ?r - robot) (speed ?r - robot) (distance ?a ?b - waypoint))
  (:durative-action move :parameters (?r - robot ?a ?b - waypoint)
    :duration (= ?duration (/ (distance ?a ?b) (speed ?r)))
    :condition (and (at start (connected ?a ?b)) (at start (robot_at ?r ?a)) (at start (free ?r))
      (at start (>= (battery ?r) (distance ?a ?b))))
    :effect (and (at start (not (robot_at ?r ?a))) (at start (not (free ?r))) (at end (free ?r))
      (at end (robot_at ?r ?b)) (at end (decrease (battery ?r) (distance ?a ?b)))))
  (:durative-action patrol :parameters (?r - robot ?w - waypoint) :duration (= ?duration 5)
    :condition (and (at start (free ?r)) (over all (robot_at ?r ?w)))
    :effect (and (at start (not (free ?r))) (at end (free ?r)) (at end (patrolled ?w))))
  (:durative-action charge :parameters (?r - robot ?w - waypoint)
    :duration (and (>= ?duration 4) (<= ?duration 9))
    :condition (and (over all (robot_at ?r ?w)) (at start (free ?r)) (at start (charging_at ?w)))
    :effect (and (at start (not (free ?r))) (at end (free ?r)) (at end (assign (battery ?r) 20)))))
"""
ROUND = """
(define (problem round) (:domain patrol)
  (:objects r2d2 - robot wp1 wp2 wp3 - waypoint)
  (:init (robot_at r2d2 wp1) (free r2d2) (connected wp1 wp2) (connected wp2 wp3) (connected wp3 wp1)
    (charging_at wp2) (= (battery r2d2) 12) (= (speed r2d2) 2)
    (= (distance wp1 wp2) 10) (= (distance wp2 wp3) 10) (= (distance wp3 wp1) 10))
  (:goal (and (patrolled wp3) (robot_at r2d2 wp3))))
"""
HATCH = """
(define (domain hatch)
  (:requirements :strips :durative-actions :timed-initial-literals :negative-preconditions)
  (:predicates (open) (loaded) (washed) (dirty))
  (:durative-action load :parameters () :duration (= ?duration 3)
    :condition (over all (open)) :effect (at end (loaded)))
  (:durative-action wash :parameters () :duration (= ?duration 2)
    :condition (and (at start (not (loaded))) (at end (dirty)))
    :effect (and (at start (not (dirty))) (at start (dirty)) (at end (washed)) (at end (not (dirty))))))
"""
WINDOW = """
(define (problem window) (:domain hatch)
  (:init (dirty) (at 10 (open)) (at 14.5 (not (open))))
  (:goal (and (loaded) (washed))))
"""


def task_of(folder: Path, domain: str, problem: str) -> TemporalTask:
    """The task in two texts."""
    (folder / "domain.pddl").write_text(domain, "utf-8")
    (folder / "problem.pddl").write_text(problem, "utf-8")
    return read_temporal(folder / "domain.pddl", folder / "problem.pddl")
