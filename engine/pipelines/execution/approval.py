"""A run that waits, before anything moves, until a person approves its plan."""

from cellwright.engine.model.execution import Order, Phase, RecordKind
from cellwright.engine.pipelines.execution.course import Course


def approved(course: Course) -> bool:
    """Whether a person lets the run begin; False if the run is stopped, or if nobody can ever say so."""
    course.recorder.note(RecordKind.PHASE, phase=Phase.READY.value, why="waits for approval")
    course.flush()
    while True:
        for given in course.orders.due(course.driver.now_ms()):
            course.order(given)
            if given.order in (Order.APPROVE, Order.STOP, Order.ABORT):
                return given.order is Order.APPROVE
        if not course.orders.wait():
            return False
