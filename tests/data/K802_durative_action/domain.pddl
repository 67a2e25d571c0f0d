(define (domain workshop)
  (:requirements :strips :typing :durative-actions)
  (:types item place)
  (:predicates (at ?i - item ?p - place))
  (:durative-action move
    :parameters (?i - item ?to - place)
    :duration (= ?duration 3)
    :condition (at start (at ?i ?to))
    :effect (at end (not (at ?i ?to)))))
