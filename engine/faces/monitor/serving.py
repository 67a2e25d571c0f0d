"""Serves the monitor: pages, orders and the stream of events, on one address."""

import asyncio
import json
from collections.abc import AsyncIterator, Callable, Mapping
from typing import Any

import uvicorn
from fastapi import FastAPI, Request
from fastapi.responses import JSONResponse, Response, StreamingResponse
from nicegui import app as pages
from nicegui import ui

from cellwright.engine.faces.monitor.door import Door
from cellwright.engine.faces.monitor.overview import build
from cellwright.engine.faces.monitor.shared import PAUSE_S, Shared
from cellwright.engine.faces.monitor.solids import known
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.json_text import parsed

LOCAL = ("127.0.0.1", "localhost", "::1")
ChangeRequest = Callable[[str, Mapping[str, Any]], tuple[int, dict[str, Any]]]
RECONNECT_S = 60.0  # for which a page whose network is cut may come back as it was; then it loads anew
HISTORY = 100  # messages that are kept for such a page; one that has missed more loads anew
SILENCE_S = 15.0  # after which a stream says that it is still there


def application(shared: Shared, host: str, port: int) -> Door:
    """The monitor as an ASGI application."""
    made = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)

    async def orders(request: Request) -> JSONResponse:
        return await _changing(request, shared.order)

    async def measurements(request: Request) -> JSONResponse:
        return await _changing(request, shared.measure)

    async def events(run: str, after: int = 0) -> StreamingResponse:
        return StreamingResponse(_stream(shared, run, after), media_type="text/event-stream")

    async def solids(key: str, number: int) -> Response:
        found = known(key)
        if found is None or not 0 <= number < len(found.files):
            return JSONResponse({"said": "there is no such body"}, 404)
        return Response(
            found.files[number], media_type="model/stl", headers={"cache-control": "max-age=86400"}
        )

    made.add_api_route("/solids/{key}/{number}", solids)
    made.add_api_route("/orders", orders, methods=["POST"])
    made.add_api_route("/measurements", measurements, methods=["POST"])
    made.add_api_route("/events/{run:path}", events)
    build(shared)
    ui.run_with(
        made,
        title="Cellwright",
        favicon="🔧",
        dark=None,
        show_welcome_message=False,
        reconnect_timeout=RECONNECT_S,
        message_history_length=HISTORY,
    )
    pages.config.socket_io_js_transports = [
        "websocket"
    ]  # a connection that asks by POST would need the token
    return Door(made, _hosts(host, port), shared.token, host in LOCAL)


def _hosts(host: str, port: int) -> list[str]:
    """What a request may name as its host."""
    names = LOCAL if host in LOCAL else (host,)
    return [f"[{name}]:{port}" if ":" in name else f"{name}:{port}" for name in names]


async def _changing(request: Request, change: ChangeRequest) -> JSONResponse:
    """The answer to a request that changes something."""
    try:
        asked = parsed(await request.body())
    except ValueError:
        asked = None
    if not isinstance(asked, dict):
        return JSONResponse({"said": "what is asked for is a JSON object"}, 400)
    key = request.headers.get("idempotency-key", "")
    status, said = await asyncio.to_thread(change, key, asked)
    return JSONResponse(said, status)


async def _stream(shared: Shared, run: str, after: int) -> AsyncIterator[str]:
    """The records of a run behind a number, as server-sent events, for as long as somebody listens."""
    try:
        await asyncio.to_thread(shared.follow, run)
    except InvalidInput as refused:
        yield f"event: refused\ndata: {json.dumps([each.message for each in refused.diagnostics])}\n\n"
        return
    quiet = 0.0
    while True:
        records = shared.follow(run).records
        fresh = records[after : after + AT_ONCE]
        if fresh:
            yield "".join(_event(run, record.number, shared) for record in fresh)
        after += len(fresh)
        quiet = 0.0 if fresh else quiet + PAUSE_S
        if quiet >= SILENCE_S:
            quiet = 0.0
            yield ": still there\n\n"
        await asyncio.sleep(0.0 if len(fresh) == AT_ONCE else PAUSE_S)


def _event(run: str, number: int, shared: Shared) -> str:
    """A record as an event; it is written once for all who listen."""
    key = (id(shared), run, number)
    if key not in _WRITTEN:
        record = shared.follow(run).records[number - 1]
        _WRITTEN[key] = f"id: {number}\ndata: {json.dumps(record.entry(run), ensure_ascii=False)}\n\n"
        while len(_WRITTEN) > KEPT:
            del _WRITTEN[next(iter(_WRITTEN))]
    return _WRITTEN[key]


_WRITTEN: dict[tuple[int, str, int], str] = {}
KEPT, AT_ONCE = 2000, 500  # events that are kept as they were written, and sent together


def serve(shared: Shared, host: str, port: int) -> None:
    """Serve until Ctrl-C."""
    settings = uvicorn.Config(application(shared, host, port), host=host, port=port, log_level="warning")
    uvicorn.Server(settings).run()
