"""A campaign that is stopped, or asked for nothing, says so in a sentence, and keeps what it
has counted.
"""

import sys
from pathlib import Path

import campaign
import pytest
from fuzz_guards import Tally


def asked(monkeypatch: pytest.MonkeyPatch, folder: Path, *words: str) -> int:
    monkeypatch.setattr(sys, "argv", ["campaign.py", "--state", str(folder), *words])
    return campaign.main()


def test_a_campaign_that_is_stopped_tells_what_it_has_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def stopped(state: campaign.State, *_: object) -> None:
        state.note("command lines", Tally(cases=7))
        raise KeyboardInterrupt

    monkeypatch.setattr(campaign, "run", stopped)
    assert asked(monkeypatch, tmp_path, "--only", "command lines") == 0
    told = capsys.readouterr().out
    assert "stopped: the next call with this seed goes on" in told
    assert "| command lines | 7 |" in told
    assert campaign.State(tmp_path, 1).tallies["command lines"].cases == 7


def test_a_target_that_is_not_there_is_told_with_those_that_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        asked(monkeypatch, tmp_path, "--only", "nothing of this name")
    assert "command lines" in capsys.readouterr().err
