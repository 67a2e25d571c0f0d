(define (problem tidy)
  (:domain workshop)
  (:init (at bolt bin))
  (:goal (not (at bolt bin))))
