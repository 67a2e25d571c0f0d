"""Tasks with maximum lags: operations on machines, lags between any two of their ends, calendars.

Each task is written as PDDL, where an action without a machine spans both operations of a lag, and
solved by a constraint model of CP-SAT that shares nothing with the engine.
"""

from dataclasses import dataclass

from ortools.sat.python import cp_model

HORIZON = 200


@dataclass(frozen=True)
class Job:
    """An operation: its machine, its shortest and longest time, and what must be done before."""

    name: str
    machine: str
    least: int
    most: int
    after: tuple[str, ...] = ()


@dataclass(frozen=True)
class LagTask:
    """Operations, and the longest times from the start of one to the end of another; when a
    machine is open, if not always.
    """

    jobs: tuple[Job, ...]
    lags: tuple[tuple[str, str, int], ...]
    opened: tuple[tuple[str, int, int], ...] = ()

    def machines(self) -> list[str]:
        return sorted({job.machine for job in self.jobs})

    def domain(self) -> str:
        """The domain in PDDL 2.1."""
        names = [f"(free_{each}) (open_{each})" for each in self.machines()]
        names += [f"(todo_{job.name}) (done_{job.name})" for job in self.jobs]
        names += [f"(span_{one}_{two})" for one, two, _ in self.lags]
        actions = [self._operation(job) for job in self.jobs] + [
            f"(:durative-action lag_{one}_{two} :parameters () :duration (<= ?duration {most}.05)"
            f" :condition (and (at start (todo_{one})) (at end (done_{two})))"
            f" :effect (and (at start (span_{one}_{two})) (at end (not (span_{one}_{two})))))"
            for one, two, most in self.lags
        ]
        needed = ":strips :durative-actions :duration-inequalities :timed-initial-literals"
        return (
            f"(define (domain lags) (:requirements {needed})\n"
            f"(:predicates {' '.join(names)})\n" + "\n".join(actions) + ")\n"
        )

    def _operation(self, job: Job) -> str:
        spans = [f"(over all (span_{a}_{b}))" for a, b, _ in self.lags if job.name in (a, b)]
        before = [f"(at start (done_{each}))" for each in job.after]
        mine = f"(at start (todo_{job.name})) (at start (free_{job.machine}))"
        taken = f"(at start (not (todo_{job.name}))) (at start (not (free_{job.machine})))"
        return (
            f"(:durative-action {job.name} :parameters ()"
            f" :duration (and (>= ?duration {job.least}) (<= ?duration {job.most}))"
            f" :condition (and {mine} (over all (open_{job.machine})) {' '.join(spans + before)})"
            f" :effect (and {taken}"
            f" (at end (free_{job.machine})) (at end (done_{job.name}))))"
        )

    def problem(self) -> str:
        """The problem in PDDL 2.2: calendars are timed literals."""
        closed = {machine for machine, _, _ in self.opened}
        facts = [f"(free_{each})" for each in self.machines()]
        facts += [f"(open_{each})" for each in self.machines() if each not in closed]
        facts += [f"(todo_{job.name})" for job in self.jobs]
        for machine, first, last in self.opened:
            facts.append(f"(at {first} (open_{machine}))" if first else f"(open_{machine})")
            facts.append(f"(at {last} (not (open_{machine})))")
        goal = " ".join(f"(done_{job.name})" for job in self.jobs)
        return (
            f"(define (problem one) (:domain lags)\n(:init {' '.join(facts)})\n"
            f"(:goal (and {goal})) (:metric minimize (total-time)))\n"
        )

    def least_makespan(self) -> int | None:
        """The optimum without separations, from a constraint model; None if nothing fits."""
        model = cp_model.CpModel()
        starts, ends, on = {}, {}, {machine: [] for machine in self.machines()}
        for job in self.jobs:
            start, end = (model.new_int_var(0, HORIZON, job.name) for _ in range(2))
            length = model.new_int_var(job.least, job.most, "length")
            on[job.machine].append(model.new_interval_var(start, length, end, job.name))
            starts[job.name], ends[job.name] = start, end
            self._keep_calendar(model, job, start, end)
        for intervals in on.values():
            model.add_no_overlap(intervals)
        for job in self.jobs:
            for each in job.after:
                model.add(starts[job.name] >= ends[each])
        for one, two, most in self.lags:
            model.add(ends[two] - starts[one] <= most)
        makespan = model.new_int_var(0, HORIZON, "makespan")
        model.add_max_equality(makespan, list(ends.values()))
        model.minimize(makespan)
        solver = cp_model.CpSolver()
        solver.parameters.num_workers = 1
        if solver.solve(model) != cp_model.OPTIMAL:
            return None
        return solver.value(makespan)

    def _keep_calendar(
        self, model: cp_model.CpModel, job: Job, start: cp_model.IntVar, end: cp_model.IntVar
    ) -> None:
        windows = [(first, last) for machine, first, last in self.opened if machine == job.machine]
        inside = []
        for first, last in windows:
            chosen = model.new_bool_var("window")
            model.add(start >= first).only_enforce_if(chosen)
            model.add(end <= last).only_enforce_if(chosen)
            inside.append(chosen)
        if inside:
            model.add_exactly_one(inside)


def fixed(name: str, machine: str, length: int, *after: str) -> Job:
    """An operation of one length."""
    return Job(name, machine, length, length, after)


def flow(lengths: list[tuple[int, int]], slack: int) -> LagTask:
    """A flow shop of two machines where each second operation ends within `slack` of no wait.

    What a flow line with a buffer that must not dry does.
    """
    jobs, lags = [], []
    for number, (first, second) in enumerate(lengths):
        jobs += [fixed(f"a{number}", "x", first), fixed(f"b{number}", "y", second, f"a{number}")]
        # the three instants that are apart need 0.001 each
        lags.append((f"a{number}", f"b{number}", first + second + slack))
    return LagTask(tuple(jobs), tuple(lags))


def plates(count: int, washers: int = 1) -> LagTask:
    """Plates of a screening: dispense, incubate 60 to 63, wash within 6, read within 10."""
    jobs, lags = [], []
    for n in range(count):
        washer = f"w{n % washers}"
        jobs += [
            fixed(f"d{n}", "dispenser", 2),
            Job(f"i{n}", f"place{n}", 60, 63, (f"d{n}",)),
            fixed(f"w{n}", washer, 5, f"i{n}"),
            fixed(f"r{n}", "reader", 7, f"w{n}"),
        ]
        # the times of wash and reading are in the limits
        lags += [(f"i{n}", f"w{n}", 63 + 6 + 5), (f"w{n}", f"r{n}", 5 + 10 + 7)]
    return LagTask(tuple(jobs), tuple(lags))


def kiln_day() -> LagTask:
    """A piece that is glazed must be in the kiln soon, and the kiln opens at 20."""
    jobs = (fixed("glaze", "bench", 4), fixed("fire", "kiln", 10, "glaze"))
    return LagTask(jobs, (("glaze", "fire", 16),), (("kiln", 20, 50),))


TASKS: dict[str, tuple[LagTask, int]] = {
    # each second step follows at once: the first machine waits for the second
    "no wait": (flow([(2, 6), (3, 1), (4, 3)], 0), 12),
    "little wait": (flow([(2, 6), (3, 1), (4, 3)], 3), 12),
    "four pieces": (flow([(1, 5), (5, 1), (3, 3), (2, 4)], 0), 15),
    "start late": (kiln_day(), 30),
    # the first window of the press is too short for both pieces, and a may not wait so long
    "two windows": (
        LagTask(
            (
                fixed("a", "x", 3),
                fixed("b", "press", 4, "a"),
                fixed("c", "x", 2),
                fixed("d", "press", 5, "c"),
            ),
            (("a", "b", 9), ("c", "d", 9)),
            (("press", 4, 11), ("press", 20, 40)),
        ),
        24,
    ),
    # two parts of a mixture must be fresh at the same time
    "mixture": (
        LagTask(
            (
                fixed("acid", "x", 3),
                fixed("base", "y", 8),
                fixed("mix", "z", 2, "acid", "base"),
            ),
            (("acid", "mix", 6), ("base", "mix", 11)),
        ),
        10,
    ),
    # one hoist lifts in and out: soaking lasts 5 to 7, then the hoist must be there
    "hoist": (
        LagTask(
            (
                fixed("in1", "hoist", 2),
                Job("soak1", "tank1", 5, 7, ("in1",)),
                fixed("out1", "hoist", 2, "soak1"),
                fixed("in2", "hoist", 2),
                Job("soak2", "tank2", 5, 7, ("in2",)),
                fixed("out2", "hoist", 2, "soak2"),
            ),
            (("soak1", "out1", 9), ("soak2", "out2", 9)),
        ),
        11,
    ),
    "one plate": (plates(1), 74),
    "three plates": (plates(3), 88),
    "slow reader": (plates(2), 81),
    # what is warm must be pressed and cut before it is cold: the lag goes over three steps
    "chain": (
        LagTask(
            (
                fixed("heat", "oven", 6),
                fixed("press", "tool", 3, "heat"),
                fixed("cut", "saw", 2, "press"),
                fixed("other", "tool", 7),
                fixed("last", "saw", 4),
            ),
            (("heat", "cut", 12),),
        ),
        12,
    ),
    # a in the first shift would be too soon for c in the second
    "shifts": (
        LagTask(
            (
                fixed("a", "tool", 4),
                fixed("b", "bath", 3, "a"),
                fixed("c", "tool", 4, "b"),
            ),
            (("a", "c", 12),),
            (("tool", 0, 9), ("tool", 15, 40)),
        ),
        26,
    ),
}
