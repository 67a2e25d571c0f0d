"""The verb `monitor`: a page in the browser on which runs are watched, steered and replayed."""

from importlib.util import find_spec
from typing import Annotated
from urllib.parse import quote

import typer
from typer import Argument, Option

from cellwright.engine.faces.cli.output.answer_output import AnswerForm, VerbAnswer, give_answer
from cellwright.engine.faces.cli.verbs.run_verbs import Store
from cellwright.engine.formats.report import rich_parts
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.store.default_path import default_store

MONITOR_PACKAGES = ("nicegui", "fastapi", "uvicorn")
Host = Annotated[
    str,
    Option(
        "--host",
        metavar="ADDRESS",
        help="serve on this address; beyond this machine, the page needs a token",
    ),
]
Port = Annotated[int, Option("--port", min=1, max=65535, help="serve on this port")]
ReadOnly = Annotated[bool, Option("--read-only", help="only watch: no page gives orders")]
RunName = Annotated[
    str, Argument(metavar="[RUN]", help="the run to begin with; without it, all runs are listed")
]


def serve_monitor(
    run: RunName = "",
    store: Store = "",
    host: Host = "127.0.0.1",
    port: Port = 8210,
    read_only: ReadOnly = False,
) -> None:
    """Serve a page on which runs are watched, steered and replayed. Ctrl-C ends it; runs go on."""
    give_answer(
        lambda: _serve_monitor(run, store or default_store(), host, port, read_only),
        AnswerForm.TEXT,
    )


def _serve_monitor(run: str, store: str, host: str, port: int, read_only: bool) -> VerbAnswer:
    _needs_the_extra()
    _port_is_free(host, port)
    from cellwright.engine.faces.monitor.shared_state import SharedState
    from cellwright.engine.faces.monitor.web_server import LOCAL_HOSTS, run_web_server

    shared = SharedState(store, read_only)
    if run:
        shared.follow(run)
    typer.echo(
        f"{_page_address(host, port, run)}{'' if host in LOCAL_HOSTS else f'?token={shared.token}'}"
    )
    run_web_server(shared, host, port)
    return VerbAnswer(
        "ok", {"store": store}, lambda: rich_parts.Text("The monitor has ended; runs go on.")
    )


def _page_address(host: str, port: int, run: str) -> str:
    name = f"[{host}]" if ":" in host else host
    return f"http://{name}:{port}/" + (f"run/{quote(run, safe='')}" if run else "")


def _needs_the_extra() -> None:
    missing = [package_name for package_name in MONITOR_PACKAGES if find_spec(package_name) is None]
    if missing:
        message = f"the monitor needs {', '.join(missing)}"
        raise InvalidInput(
            [
                Diagnostic(
                    Source("cellwright monitor"),
                    "K502",
                    message,
                    "pip install 'cellwright[monitor]'",
                )
            ]
        )


def _port_is_free(host: str, port: int) -> None:
    """Raise `InvalidInput` if nothing can be served there."""
    import socket

    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.socket(family, socket.SOCK_STREAM) as trial:
        trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            trial.bind((host, port))
        except OSError as error:
            message = f"nothing can be served on {host}, port {port}: {error.strerror or error}"
            raise InvalidInput(
                [Diagnostic(Source("--port"), "K415", message, "give another --port")]
            ) from error
