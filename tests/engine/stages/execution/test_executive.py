"""The executive alone: a table of transitions, driven here by a clock that the tests turn."""

import heapq
from dataclasses import dataclass, field, replace

from hypothesis import given, settings
from hypothesis import strategies as st

from cellwright.engine.model.run_protocol import RunPhase
from cellwright.engine.stages import execution as x
from cellwright.engine.stages.execution import Activity, ActivityProgram, Dwell


@dataclass
class Bench:
    """Devices that do what they are told; those with a queue one after another.

    `lasts` overrides forecasts.
    """

    program: ActivityProgram
    lasts: dict[int, int] = field(default_factory=dict)
    now: int = 0
    begun: dict[int, int] = field(default_factory=dict)
    ended: dict[int, int] = field(default_factory=dict)
    waits: int = 0
    effects: list[x.Effect] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.standing = x.standing_of(self.program, 0, 1)
        self.ends: list[tuple[int, int]] = []
        self.queues: dict[str, list[x.Dispatch]] = {}
        self.held: dict[str, int] = {}
        self.continued: set[int] = set()
        self.numbers: dict[int, int] = {}

    def take(self, event: x.Event) -> None:
        self.standing, effects = x.advance_run(self.program, self.standing, event, self.now)
        for effect in effects:
            self.effects.append(effect)
            if isinstance(effect, x.Dispatch):
                self.receive(effect)

    def receive(self, sent: x.Dispatch) -> None:
        if sent.about is not None:
            self.continued.add(sent.about)
        elif self.program.lookahead.get(sent.stream, 1) > 1:
            self.queues.setdefault(sent.stream, []).append(sent)
        else:
            self.begin(sent)
        self.serve()

    def serve(self) -> None:
        for stream, queue in self.queues.items():
            while queue and stream not in self.held:
                if queue[0].activity is None:
                    if queue[0].number not in self.continued:
                        break
                    queue.pop(0)
                    self.waits += 1
                    continue
                sent = queue.pop(0)
                self.held[stream] = sent.number
                self.begin(sent)

    def begin(self, sent: x.Dispatch) -> None:
        assert sent.activity is not None
        self.begun[sent.activity] = self.now
        self.numbers[sent.number] = sent.activity
        lasts = self.lasts.get(sent.activity, self.program.activities[sent.activity].lasts_ms)
        heapq.heappush(self.ends, (self.now + lasts, sent.number))

    def run(self, until: int | None = None) -> None:
        while self.ends or x.next_time(self.program, self.standing) is not None:
            due = x.next_time(self.program, self.standing)
            times = [
                each for each in (self.ends[0][0] if self.ends else None, due) if each is not None
            ]
            if until is not None and min(times) > until:
                self.now = until
                return
            self.now = min(times)
            if self.ends and self.ends[0][0] == self.now:
                _, number = heapq.heappop(self.ends)
                self.ended[self.numbers[number]] = self.now
                stream = self.program.activities[self.numbers[number]].stream
                if self.held.get(stream) == number:
                    del self.held[stream]
                self.take(x.Replied(number))
                self.serve()
            else:
                self.take(x.TimePassed())
            if self.standing.phase in (RunPhase.FINISHED, RunPhase.STOPPED, RunPhase.HANDLING):
                return


def program(*activities: Activity, **given: object) -> ActivityProgram:
    return replace(ActivityProgram({each.id: each for each in activities}), **given)  # type: ignore[arg-type]


@st.composite
def programs(draw: st.DrawFn, queues: bool = False) -> ActivityProgram:
    count = draw(st.integers(1, 9))
    made = {}
    ends = dict.fromkeys("abc", 0)
    last: dict[int, int] = {}
    for n in range(1, count + 1):
        after = tuple(sorted(draw(st.sets(st.integers(1, n - 1), max_size=3)))) if n > 1 else ()
        resources = tuple(sorted(draw(st.sets(st.sampled_from("abc"), max_size=2))))
        lasts = draw(st.integers(0, 20))
        start = max([0, *(last[each] for each in after), *(ends[each] for each in resources)])
        stream = draw(st.sampled_from(["arm", "oven", "eye"]))
        if queues and "a" not in resources and stream == "arm":
            resources = (*resources, "a") if "a" not in resources else resources
            start = max(start, ends["a"])
        last[n] = start + lasts
        ends |= {each: last[n] for each in resources}
        made[n] = Activity(n, f"s{n}", stream, lasts, after, resources, start)
    return ActivityProgram(made, lookahead={"arm": draw(st.integers(2, 4))} if queues else {})


def broken(bench: Bench) -> str:
    """What is wrong with what happened; nothing if every order was kept and no resource was
    held twice.
    """
    for each in bench.program.activities.values():
        if each.id not in bench.ended:
            return f"{each.id} has not ended"
        if any(bench.ended[before] > bench.begun[each.id] for before in each.after):
            return f"{each.id} began before its predecessors ended"
        for other in bench.program.activities.values():
            shared = set(each.resources) & set(other.resources)
            apart = (
                bench.ended[each.id] <= bench.begun[other.id]
                or bench.ended[other.id] <= bench.begun[each.id]
            )
            if other.id != each.id and shared and not apart:
                return f"{each.id} and {other.id} held {shared} at once"
    return ""


@given(programs(), st.lists(st.integers(0, 40), min_size=9, max_size=9))
@settings(max_examples=150, deadline=None)
def test_every_order_is_kept_however_long_steps_take(
    made: ActivityProgram, lasts: list[int]
) -> None:
    bench = Bench(made, dict(enumerate(lasts, 1)))
    bench.take(x.Began())
    bench.run()
    assert broken(bench) == ""
    assert bench.standing.phase is RunPhase.FINISHED


@given(programs())
@settings(max_examples=150, deadline=None)
def test_the_forecast_is_met_when_steps_take_as_long_as_forecast(made: ActivityProgram) -> None:
    bench = Bench(made)
    bench.take(x.Began())
    bench.run()
    assert bench.now <= made.forecast_ms


@given(programs(queues=True), st.lists(st.integers(0, 40), min_size=9, max_size=9))
@settings(max_examples=150, deadline=None)
def test_streams_that_look_ahead_keep_every_order(made: ActivityProgram, lasts: list[int]) -> None:
    bench = Bench(made, dict(enumerate(lasts, 1)))
    bench.take(x.Began())
    bench.run()
    assert broken(bench) == ""


def test_a_queued_command_waits_for_another_stream() -> None:
    bench = Bench(
        program(
            Activity(1, "heat", "oven", 10, (), ("oven",)),
            Activity(2, "fetch", "arm", 3, (), ("arm",)),
            Activity(3, "take", "arm", 3, (1, 2), ("arm",), 10),
            lookahead={"arm": 3},
        )
    )
    bench.take(x.Began())
    sent = [each for each in bench.effects if isinstance(each, x.Dispatch)]
    assert [each.activity for each in sent] == [1, 2, None, 3]
    bench.run()
    assert (bench.waits, bench.begun[3]) == (1, 10)


def test_a_step_overtakes_one_that_is_late_only_if_it_ends_before_that_can_begin() -> None:
    steps = (
        Activity(1, "slow", "oven", 10, (), ("oven",), 0),
        Activity(2, "next", "arm", 5, (1,), ("arm",), 10),
        Activity(3, "short", "arm", 4, (), ("arm",), 15),
        Activity(4, "long", "arm", 12, (), ("arm",), 19),
    )
    bench = Bench(program(*steps))
    bench.take(x.Began())
    bench.run()
    assert bench.begun == {1: 0, 3: 0, 2: 10, 4: 15}


def test_an_interruption_waits_until_the_hand_is_empty() -> None:
    pick = Activity(1, "pick", "arm", 5, (), ("arm",), rests=False)
    put = Activity(2, "put", "arm", 5, (1,), ("arm",), 5)
    more = Activity(3, "pick", "arm", 5, (2,), ("arm",), 10, rests=False)
    oven = Activity(4, "heat", "oven", 50, (), ("oven",), process=True)
    bench = Bench(program(pick, put, more, oven))
    bench.take(x.Began())
    bench.now = 2
    bench.take(x.Interrupted())
    bench.run(until=20)
    assert (bench.standing.phase, sorted(bench.begun)) == (RunPhase.PAUSED, [1, 2, 4])
    bench.take(x.Continued())
    bench.run()
    assert (bench.standing.phase, bench.begun[3], bench.ended[4]) == (RunPhase.FINISHED, 20, 50)


def test_a_hand_that_is_full_and_waits_for_a_process_is_not_a_pause() -> None:
    pick = Activity(1, "pick", "arm", 5, (), ("arm", "probe"), rests=False)
    oven = Activity(2, "heat", "oven", 50, (), ("oven",), process=True)
    put = Activity(3, "put", "arm", 5, (1, 2), ("arm", "oven"), 50)
    more = Activity(4, "press", "arm", 5, (3,), ("arm",), 55)
    bench = Bench(replace(program(pick, oven, put, more), hands=frozenset({"arm"})))
    bench.take(x.Began())
    bench.now = 2
    bench.take(x.Interrupted())
    bench.run(until=100)
    assert (bench.standing.phase, sorted(bench.begun), bench.ended[3]) == (
        RunPhase.PAUSED,
        [1, 2, 3],
        55,
    )


def test_a_hand_that_is_full_and_waits_for_its_time_is_not_a_pause() -> None:
    pick = Activity(1, "pick", "arm", 5, (), ("arm",), rests=False)
    put = Activity(2, "put", "arm", 5, (1,), ("arm",), 20)
    more = Activity(3, "press", "arm", 5, (2,), ("arm",), 25)
    bench = Bench(program(pick, put, more, timed=True))
    bench.take(x.Began())
    bench.take(x.Interrupted())
    bench.run(until=100)
    assert (bench.standing.phase, bench.begun) == (RunPhase.PAUSED, {1: 0, 2: 20})


def test_a_stop_halts_at_once_and_nothing_begins_any_more() -> None:
    bench = Bench(
        program(
            Activity(1, "a", "arm", 5, (), ("arm",)), Activity(2, "b", "arm", 5, (1,), ("arm",), 5)
        )
    )
    bench.take(x.Began())
    bench.now = 1
    bench.take(x.StopCommanded())
    assert isinstance(bench.effects[-1], x.Halt)
    bench.take(x.Replied(1))
    assert (bench.standing.phase, list(bench.begun)) == (RunPhase.STOPPED, [1])


def test_a_missing_reply_is_a_failure_and_the_others_come_to_their_end_first() -> None:
    bench = Bench(
        program(
            Activity(1, "a", "arm", 5, (), ("arm",), timeout_ms=20),
            Activity(2, "b", "oven", 40, (), ("oven",)),
            Activity(3, "c", "oven", 1, (2,), ("oven",), 40),
        ),
        {1: 10**6},
    )
    bench.take(x.Began())
    bench.run()
    handled = next(each for each in bench.effects if isinstance(each, x.Handle))
    assert [(each.activity, each.reply) for each in handled.failures] == [(1, "timeout")]
    assert (bench.now, 3 in bench.begun) == (40, False)


def test_a_wait_that_will_be_too_long_is_told_before_it_is() -> None:
    bench = Bench(
        program(
            Activity(1, "heat", "oven", 10, (), ("oven",)),
            Activity(2, "other", "arm", 12, (), ("arm",)),
            Activity(3, "take", "arm", 3, (1, 2), ("arm",), 12),
            dwells=(Dwell(1, 3, 4),),
        ),
        {2: 30},
    )
    bench.take(x.Began())
    bench.run(until=14)
    threats = [each for each in bench.effects if isinstance(each, x.Threatened)]
    assert [each.dwell.target for each in threats] == [3]
    assert bench.now <= 15


def test_a_standing_made_from_what_is_done_goes_on_where_the_first_one_was() -> None:
    made = program(
        Activity(1, "a", "arm", 5, (), ("arm",)),
        Activity(2, "b", "arm", 5, (1,), ("arm",), 5),
        Activity(3, "c", "arm", 5, (2,), ("arm",), 10),
    )
    standing = x.standing_of(made, 7, 3, RunPhase.RUNNING, {1}, {2: x.Running(2, 5)})
    standing, effects = x.advance_run(made, standing, x.Replied(2), 10)
    assert [each.activity for each in effects if isinstance(each, x.Dispatch)] == [3]
