"""What an order tells the editor while it is carried out, without a process and without an
editor.
"""

import asyncio
from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("pygls")

from pygls.lsp.server import LanguageServer

from cellwright.engine.faces.lsp import code_lenses
from cellwright.engine.faces.lsp.open_files import OpenFiles


class Progress:
    """What the editor keeps about work in progress: it refuses a token that it knows already."""

    def __init__(self) -> None:
        self.tokens: list[str] = []
        self.ended: list[str] = []

    async def create_async(self, token: str) -> None:
        assert token not in self.tokens
        self.tokens.append(token)

    def begin(self, token: str, _: Any) -> None:
        assert token == self.tokens[-1]

    def end(self, token: str, _: Any) -> None:
        self.ended.append(token)


def test_every_order_has_a_token_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    async def ran(
        _s: LanguageServer, arguments: list[str], _d: OpenFiles, token: str
    ) -> tuple[int, str]:
        return 0, f"{arguments[0]} {token}"

    async def told(*_: Any) -> None:
        return None

    monkeypatch.setattr(code_lenses, "_run_command", ran)
    monkeypatch.setattr(code_lenses, "_show_output", told)
    progress = Progress()
    window = SimpleNamespace(work_done_progress=True, show_document=None)
    server: Any = SimpleNamespace(
        work_done_progress=progress, client_capabilities=SimpleNamespace(window=window)
    )
    for _ in range(50):
        asyncio.run(
            code_lenses.run_lens_command(
                server, OpenFiles(), "cellwright.check", "file:///cell/domain.yaml"
            )
        )
    assert progress.ended == progress.tokens
    assert len(progress.tokens) == 50
