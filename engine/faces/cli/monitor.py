"""`cellwright monitor`: watch, steer and replay runs in the browser."""

from typing import Annotated

import typer

from cellwright.engine.faces.cli.answers import Answer, Form, give
from cellwright.engine.faces.cli.declared import Argument, Option
from cellwright.engine.faces.cli.run import Store
from cellwright.kb.store.own import default_store

EXTRA = ("nicegui", "fastapi", "uvicorn")
Host = Annotated[
    str,
    Option(
        "--host", metavar="ADDRESS", help="serve on this address; beyond this machine, the page needs a token"
    ),
]
Port = Annotated[int, Option("--port", min=1, max=65535, help="serve on this port")]
ReadOnly = Annotated[bool, Option("--read-only", help="only watch: no page gives orders")]
RunName = Annotated[
    str, Argument(metavar="[RUN]", help="the run to begin with; without it, all runs are listed")
]


def monitor(
    run: RunName = "",
    store: Store = "",
    host: Host = "127.0.0.1",
    port: Port = 8210,
    read_only: ReadOnly = False,
) -> None:
    """Serve a page on which runs are watched, steered and replayed. Ctrl-C ends it; runs go on."""
    give(lambda: _served(run, store or default_store(), host, port, read_only), Form.TEXT)


def _served(run: str, store: str, host: str, port: int, read_only: bool) -> Answer:
    from rich.text import Text

    _needs_the_extra()
    _port_is_free(host, port)
    from cellwright.engine.faces.monitor.serving import LOCAL, serve
    from cellwright.engine.faces.monitor.shared import Shared

    shared = Shared(store, read_only)
    if run:
        shared.follow(run)
    typer.echo(f"{_address(host, port, run)}{'' if host in LOCAL else f'?token={shared.token}'}")
    serve(shared, host, port)
    return Answer("ok", {"store": store}, lambda: Text("The monitor has ended; runs go on."))


def _address(host: str, port: int, run: str) -> str:
    from urllib.parse import quote

    name = f"[{host}]" if ":" in host else host
    return f"http://{name}:{port}/" + (f"run/{quote(run, safe='')}" if run else "")


def _needs_the_extra() -> None:
    from importlib.util import find_spec

    from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source

    missing = [each for each in EXTRA if find_spec(each) is None]
    if missing:
        said = f"the monitor needs {', '.join(missing)}"
        raise InvalidInput(
            [Diagnostic(Source("cellwright monitor"), "K502", said, "pip install 'cellwright[monitor]'")]
        )


def _port_is_free(host: str, port: int) -> None:
    """Raise `InvalidInput` if nothing can be served there."""
    import socket

    from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source

    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.socket(family, socket.SOCK_STREAM) as trial:
        trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            trial.bind((host, port))
        except OSError as error:
            said = f"nothing can be served on {host}, port {port}: {error.strerror or error}"
            raise InvalidInput([Diagnostic(Source("--port"), "K415", said, "give another --port")]) from error
