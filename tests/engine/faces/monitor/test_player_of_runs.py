"""A page goes through a run forwards and backwards, and stays at its end while it is live."""

from pathlib import Path

import pytest

from cellwright.engine.faces.monitor.run_follower import RunFollower, RunPlayer
from cellwright.kb.store.journal import Journal, JournalLine

TIMES = (0, 0, 1_000, 5_000, 5_000, 60_000)


@pytest.fixture
def follower(tmp_path: Path) -> RunFollower:
    with Journal(str(tmp_path / "runs.db")) as journal:
        journal.begin("monday", "2026-11-22", {"factor": 0.5})
        lines = [
            JournalLine(n, at, "goal", {"goal": f"g({n})"}) for n, at in enumerate(TIMES[:-1], 1)
        ]
        failed = {
            "exception": "cold",
            "step": 1,
            "action": "heat(a)",
            "reply": "cold",
            "command": 2,
        }
        journal.append("monday", [*lines, JournalLine(len(TIMES), TIMES[-1], "exception", failed)])
    found = RunFollower(str(tmp_path / "runs.db"), "monday")
    found.refresh()
    return found


def test_live_it_is_at_the_end_and_time_goes_on_as_in_the_cell(follower: RunFollower) -> None:
    player = RunPlayer(follower)
    player.tick(1000.0)
    assert (player.number, player.clock_ms) == (len(TIMES), 60_000)
    player.tick(1003.0)
    assert player.clock_ms == 66_000  # half a second for a second
    player.tick(1004.0, goes_on=False)
    assert player.clock_ms == 60_000


@pytest.mark.parametrize("speed", [1, 10, 1000])
def test_it_plays_to_the_end_and_back_again(follower: RunFollower, speed: int) -> None:
    player, now, seen = RunPlayer(follower), 10.0, list[int]()
    for direction in (speed, -speed):
        player.play(direction)
        player.tick(now)
        while player.speed:
            now += 0.5
            player.tick(now)
            seen.append(player.number)
        assert player.clock_ms == (60_000 if direction > 0 else 0)
    top = seen.index(len(TIMES))
    assert seen[: top + 1] == sorted(seen[: top + 1])
    assert seen[top:] == sorted(seen[top:], reverse=True)


def test_it_shows_the_records_up_to_its_time(follower: RunFollower) -> None:
    assert [follower.number_at(each) for each in (0, 999, 1_000, 5_000, 1e9)] == [2, 2, 3, 5, 6]


def test_it_goes_to_the_exception_and_stands_there(follower: RunFollower) -> None:
    player = RunPlayer(follower)
    assert player.to_exception()
    assert (player.number, player.live, player.speed) == (6, False, 0.0)
    player.go_to(99)
    assert player.number == len(TIMES)
    player.go_to(-5)
    assert player.number == 0
