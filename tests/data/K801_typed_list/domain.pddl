(define (domain workshop)
  (:requirements :strips :typing)
  (:types item place)
  (:predicates (at ?i - item ?p - place))
  (:action move
    :parameters (?i - item from ?to - place)
    :precondition (at ?i ?to)
    :effect (not (at ?i ?to))))
