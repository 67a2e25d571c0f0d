"""What may come in through the monitor's door, and what is refused."""

import asyncio
from collections.abc import MutableMapping
from pathlib import Path
from typing import Any

import pytest

from cellwright.engine.faces.monitor.access_control import AccessControl, IdempotencyCache
from cellwright.engine.faces.monitor.shared_state import SharedState

TOKEN = "a-token"
HOST = "127.0.0.1:8210"


def asked(
    method: str = "GET", local: bool = True, query: str = "", kind: str = "http", **headers: str
) -> tuple[int, dict[str, str]]:
    """The status of a request's answer, 101 for a connection that is let in, and its headers."""
    sent: list[MutableMapping[str, Any]] = []

    async def inner(_scope: Any, _receive: Any, send: Any) -> None:
        start = "websocket.accept" if kind == "websocket" else "http.response.start"
        await send({"type": start, "status": 101 if kind == "websocket" else 200, "headers": []})

    async def receive() -> MutableMapping[str, Any]:
        return {"type": "websocket.connect"}

    async def send(message: MutableMapping[str, Any]) -> None:
        sent.append(message)

    named = {"host": HOST, **{name.replace("_", "-"): value for name, value in headers.items()}}
    scope = {
        "type": kind,
        "method": method,
        "query_string": query.encode(),
        "headers": [(name.encode(), value.encode()) for name, value in named.items()],
    }
    asyncio.run(AccessControl(inner, [HOST], TOKEN, local)(scope, receive, send))
    first = sent[0]
    answered = {name.decode(): value.decode() for name, value in first.get("headers", [])}
    return int(first.get("status", first.get("code", 101))), answered


def test_this_machine_may_look_without_a_token() -> None:
    assert asked()[0] == 200
    assert asked(kind="websocket", origin=f"http://{HOST}")[0] == 101


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1", "127.0.0.1:9", ""])
def test_another_host_is_refused(host: str) -> None:
    assert asked(host=host)[0] == 421


@pytest.mark.parametrize("kind", ["http", "websocket"])
def test_pages_of_other_sites_are_refused(kind: str) -> None:
    status = 403 if kind == "http" else 1008
    assert asked(kind=kind, origin="http://evil.example")[0] == status
    assert asked(kind=kind, origin="null")[0] == status


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "PATCH"])
def test_whatever_changes_something_needs_the_token(method: str) -> None:
    assert asked(method)[0] == 403
    assert asked(method, x_cellwright_token="another")[0] == 403
    assert asked(method, x_cellwright_token=TOKEN)[0] == 200
    assert asked(method, query=f"token={TOKEN}")[0] == 403  # an address alone changes nothing


def test_beyond_this_machine_everything_needs_the_token() -> None:
    assert asked(local=False)[0] == 401
    assert asked(local=False, kind="websocket")[0] == 1008
    status, headers = asked(local=False, query=f"token={TOKEN}")
    assert status == 200
    assert "HttpOnly" in headers["set-cookie"]
    assert "SameSite=Strict" in headers["set-cookie"]
    assert asked(local=False, cookie=f"cellwright_token={TOKEN}")[0] == 200
    assert asked(local=False, cookie="cellwright_token=guess")[0] == 401


def test_a_request_that_comes_again_changes_nothing() -> None:
    once, made = IdempotencyCache(), []
    for key in ("a", "a", "b"):
        once.answer(key, lambda: made.append(1))
    assert len(made) == 2


@pytest.mark.parametrize(
    ("key", "order", "status"), [("", "stop", 400), ("k", "drop tables", 400), ("k", "stop", 409)]
)
def test_orders_without_a_key_unknown_ones_and_those_to_nobody_are_refused(
    tmp_path: Path, key: str, order: str, status: int
) -> None:
    shared = SharedState(str(tmp_path / "runs.db"))
    assert shared.order(key, {"run": "monday", "order": order})[0] == status


def test_who_may_only_watch_gives_no_orders(tmp_path: Path) -> None:
    shared = SharedState(str(tmp_path / "runs.db"), read_only=True)
    assert shared.order("k", {"run": "monday", "order": "stop"})[0] == 403
