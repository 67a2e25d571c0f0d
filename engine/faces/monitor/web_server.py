"""The web server of the monitor: its pages, the list of runs, orders, and the event stream."""

import asyncio
import json
import shlex
from collections.abc import AsyncIterator, Callable, Mapping
from typing import Any
from urllib.parse import quote

import uvicorn
from fastapi import FastAPI, Request
from fastapi.responses import JSONResponse, Response, StreamingResponse
from nicegui import app as pages
from nicegui import ui

from cellwright.engine.faces.monitor.access_control import AccessControl
from cellwright.engine.faces.monitor.cell_bodies import bodies_of_key
from cellwright.engine.faces.monitor.measurement_page import ChoosingPage, MeasuringPage
from cellwright.engine.faces.monitor.page_frame import page_head, page_heading
from cellwright.engine.faces.monitor.run_page import PHASE_LOOKS, RunPage
from cellwright.engine.faces.monitor.run_steering import start_form
from cellwright.engine.faces.monitor.shared_state import JOURNAL_PAUSE_S, LONG_COMMANDS, SharedState
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.json_text import parse_json


def build_pages(shared: SharedState) -> None:
    """Make the pages of a monitor."""

    def overview() -> None:
        _overview_page(shared)

    def run_page(name: str) -> None:
        _page_or_refusal(lambda: RunPage(shared, name), "/")

    def work() -> None:
        _work_page(shared)

    def choosing() -> None:
        ChoosingPage(shared)

    def measuring(name: str) -> None:
        _page_or_refusal(lambda: MeasuringPage(shared, name), "/measure")

    ui.page("/")(overview)
    ui.page("/work")(work)
    ui.page("/measure")(choosing)
    ui.page("/measure/{name:path}")(measuring)
    ui.page("/run/{name:path}")(run_page)


RUN_LINK = '<q-td :props="props"><a :href="props.row.link">{{ props.row.run }}</a></q-td>'
RUN_COLUMNS = ("run", "target", "begun", "stands")
MAX_RUNS = 300  # runs, the newest
OVERVIEW_PAUSE_S = 2.0


def _overview_page(shared: SharedState) -> None:
    """All runs of the store, the newest first, with those that go on."""
    page_head(shared)
    page_heading("Runs", "runs")
    if not shared.read_only:
        start_form()
    columns = [
        {"name": column, "label": column, "field": column, "align": "left"}
        for column in RUN_COLUMNS
    ]
    table = ui.table(columns=columns, rows=[], row_key="run").classes("w-full").props("dense flat")
    table.props('hide-no-data data-testid="runs"').add_slot("body-cell-run", RUN_LINK)
    said = (
        f"The store {shared.store} has no run yet. Begin one: cellwright run TARGET --store "
        f"{shared.store}"
    )
    none = ui.label(said)

    async def show() -> None:
        rows = await asyncio.to_thread(_run_rows, shared)
        none.set_visibility(not rows)
        if rows != table.rows:
            table.rows = rows

    ui.timer(OVERVIEW_PAUSE_S, show)


def _run_rows(shared: SharedState) -> list[dict[str, str]]:
    going, runs, rows = shared.going_on(), shared.runs()[:MAX_RUNS], []
    ends = shared.outcomes([ended_run.run for ended_run in runs if ended_run.run not in going])
    for begun_run in runs:
        end = ends.get(begun_run.run, "")
        sign = PHASE_LOOKS[end][0] if end in PHASE_LOOKS else "■"
        stands = (
            "▶ goes on"
            if begun_run.run in going
            else f"{sign} {end or 'ended without a word; it can be resumed'}"
        )
        begun = begun_run.begun[:16].replace("T", " ")
        address = f"/run/{quote(begun_run.run, safe='')}"
        rows.append({"run": begun_run.run, "target": str(begun_run.document.get("target", "")), "begun": f"{begun} "
        "UTC", "stands": stands, "link": address})  # fmt: skip
    return rows


def _work_page(shared: SharedState) -> None:
    """Commands that take long, with what they tell of their progress."""
    page_head(shared)
    page_heading("Preparation and long work", "long work")
    if not shared.read_only:
        with ui.row().classes("items-center"):
            words = ui.input("command", value="prepare bulkhead --store prepared.db").classes(
                "w-96"
            )
            words.props('dense data-testid="words"')

            async def begin() -> None:
                asked = json.dumps({"order": "work", "text": str(words.value or "")})
                await ui.run_javascript(f"return send('/orders', {asked})", timeout=90.0)

            ui.button("Begin", on_click=begin).props('dense no-caps data-testid="begin"')
        ui.label(
            f"What can be begun: {', '.join(LONG_COMMANDS)}; it works in {shared.sheets.folder}"
        )
    shown = ui.column().classes("w-full")

    def show() -> None:
        shown.clear()
        with shown:
            for job in shared.jobs[::-1]:
                stands = (
                    "works"
                    if job.code is None
                    else "✓ done"
                    if job.code == 0
                    else f"✗ ended with {job.code}"
                )
                ui.label(f"{shlex.join(job.words)}: {stands}, {job.seconds:.0f} s").props(
                    'data-testid="job"'
                )
                text = (
                    ui.label(job.text[-4000:])
                    .classes("text-caption")
                    .props('data-testid="job-text"')
                )
                text.style("white-space: pre; font-family: monospace; overflow-x: auto")

    ui.timer(0.5, show)


def _page_or_refusal(make: Callable[[], object], back: str) -> None:
    """A page, or why there is none."""
    try:
        make()
    except InvalidInput as refused:
        ui.label(refused.diagnostics[0].message).classes("text-h6")
        ui.link("back", back)


LOCAL_HOSTS = ("127.0.0.1", "localhost", "::1")
ChangeRequest = Callable[[str, Mapping[str, Any]], tuple[int, dict[str, Any]]]
# for which a page whose network is cut may come back as it was; then it loads anew
RECONNECT_S = 60.0
MAX_MESSAGES = 100  # messages that are kept for such a page; one that has missed more loads anew
SILENCE_S = 15.0  # after which a stream says that it is still there


def monitor_application(shared: SharedState, host: str, port: int) -> AccessControl:
    """The monitor as an ASGI application."""
    api = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)

    async def orders(request: Request) -> JSONResponse:
        return await _answer_change(request, shared.order)

    async def measurements(request: Request) -> JSONResponse:
        return await _answer_change(request, shared.measure)

    async def events(run: str, after: int = 0) -> StreamingResponse:
        return StreamingResponse(_event_stream(shared, run, after), media_type="text/event-stream")

    async def solids(key: str, number: int) -> Response:
        bodies = bodies_of_key(key)
        if bodies is None or not 0 <= number < len(bodies.files):
            return JSONResponse({"said": "there is no such body"}, 404)
        return Response(
            bodies.files[number], media_type="model/stl", headers={"cache-control": "max-age=86400"}
        )

    api.add_api_route("/solids/{key}/{number}", solids)
    api.add_api_route("/orders", orders, methods=["POST"])
    api.add_api_route("/measurements", measurements, methods=["POST"])
    api.add_api_route("/events/{run:path}", events)
    build_pages(shared)
    ui.run_with(
        api,
        title="Cellwright",
        favicon="🔧",
        dark=None,
        show_welcome_message=False,
        reconnect_timeout=RECONNECT_S,
        message_history_length=MAX_MESSAGES,
    )
    pages.config.socket_io_js_transports = [
        "websocket"
    ]  # a connection that asks by POST would need the token
    return AccessControl(api, _allowed_hosts(host, port), shared.token, host in LOCAL_HOSTS)


def _allowed_hosts(host: str, port: int) -> list[str]:
    """What a request may name as its host."""
    names = LOCAL_HOSTS if host in LOCAL_HOSTS else (host,)
    return [f"[{name}]:{port}" if ":" in name else f"{name}:{port}" for name in names]


async def _answer_change(request: Request, change: ChangeRequest) -> JSONResponse:
    """The answer to a request that changes something."""
    try:
        asked = parse_json(await request.body())
    except ValueError:
        asked = None
    if not isinstance(asked, dict):
        return JSONResponse({"said": "what is asked for is a JSON object"}, 400)
    key = request.headers.get("idempotency-key", "")
    status, said = await asyncio.to_thread(change, key, asked)
    return JSONResponse(said, status)


async def _event_stream(shared: SharedState, run: str, after: int) -> AsyncIterator[str]:
    """The records of a run behind a number, as server-sent events, for as long as somebody
    listens.
    """
    try:
        await asyncio.to_thread(shared.follow, run)
    except InvalidInput as refused:
        yield (
            "event: refused\ndata: "
            f"{json.dumps([diagnostic.message for diagnostic in refused.diagnostics])}\n\n"
        )
        return
    quiet = 0.0
    while True:
        records = shared.follow(run).records
        fresh = records[after : after + AT_ONCE]
        if fresh:
            yield "".join(_event_text(run, record.number, shared) for record in fresh)
        after += len(fresh)
        quiet = 0.0 if fresh else quiet + JOURNAL_PAUSE_S
        if quiet >= SILENCE_S:
            quiet = 0.0
            yield ": still there\n\n"
        await asyncio.sleep(0.0 if len(fresh) == AT_ONCE else JOURNAL_PAUSE_S)


def _event_text(run: str, number: int, shared: SharedState) -> str:
    """A record as an event; it is written once for all who listen."""
    key = (id(shared), run, number)
    if key not in _EVENT_TEXTS:
        record = shared.follow(run).records[number - 1]
        _EVENT_TEXTS[key] = (
            f"id: {number}\ndata: {json.dumps(record.entry(run), ensure_ascii=False)}\n\n"
        )
        while len(_EVENT_TEXTS) > KEPT:
            del _EVENT_TEXTS[next(iter(_EVENT_TEXTS))]
    return _EVENT_TEXTS[key]


_EVENT_TEXTS: dict[tuple[int, str, int], str] = {}
KEPT, AT_ONCE = 2000, 500  # events that are kept as they were written, and sent together


def run_web_server(shared: SharedState, host: str, port: int) -> None:
    """Serve until Ctrl-C."""
    settings = uvicorn.Config(
        monitor_application(shared, host, port), host=host, port=port, log_level="warning"
    )
    uvicorn.Server(settings).run()
