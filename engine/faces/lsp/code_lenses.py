"""Code lenses above a problem or domain: plan it, run it, explain it, check it.

The command line does the work in a process of its own. It reads the texts as the editor has them,
saved or not.
"""

import asyncio
import contextlib
import json
import os
import re
import sys
import tempfile
import uuid
from pathlib import Path
from typing import Any

from lsprotocol import types
from pygls.lsp.server import LanguageServer

from cellwright.engine.faces.lsp.open_files import OpenFiles, path_of

COMMAND_TIMEOUT_S = 120  # that an order may take
LENS_VERBS = {f"cellwright.{verb}": verb for verb in ("plan", "run", "explain", "check")}
"""For each command, which is also the title of a lens, the verb of the command line."""
_HEAD_LINE = re.compile(r"^(problem|domain)[ \t]*:", re.MULTILINE)
_COMMAND_LINE = (
    "from cellwright.engine.faces.cli.editor_buffers import run_with_buffers; run_with_buffers()"
)


def code_lenses(desk: OpenFiles, asked: types.CodeLensParams) -> list[types.CodeLens]:
    """The orders that a file can be given, above its first line."""
    page = desk.page(asked.text_document.uri)
    head_line = (
        _HEAD_LINE.search(page.file.text)
        if page is not None and page.file.kind in ("problem", "domain")
        else None
    )
    if page is None or head_line is None:
        return []
    commands = list(LENS_VERBS)[:3] if page.file.kind == "problem" else list(LENS_VERBS)[3:]
    where = page.lines.range(head_line.start(), head_line.end())
    uri = asked.text_document.uri
    return [
        types.CodeLens(where, types.Command(LENS_VERBS[command], command=command, arguments=[uri]))
        for command in commands
    ]


async def run_lens_command(
    server: LanguageServer, desk: OpenFiles, command: str, uri: str
) -> dict[str, Any]:
    """Carry an order out, show what it says, and return it with its exit code."""
    verb, path = LENS_VERBS[command], path_of(uri)
    name = f"{verb} {Path(path).stem}"
    token = f"{name} {uuid.uuid4()}"
    progress = server.work_done_progress
    shown = (
        server.client_capabilities.window is not None
        and server.client_capabilities.window.work_done_progress
    )
    if shown:
        await progress.create_async(token)
        progress.begin(
            token, types.WorkDoneProgressBegin(title=f"cellwright {name}", cancellable=True)
        )
    try:
        code, said = await _run_command(
            server,
            [verb, path, "--time-limit", str(COMMAND_TIMEOUT_S)],
            desk,
            token if shown else "",
        )
    finally:
        if shown:
            progress.end(token, types.WorkDoneProgressEnd())
    await _show_output(server, name, code, said)
    return {"command": f"cellwright {verb} {path}", "exit_code": code, "text": said}


async def _run_command(
    server: LanguageServer, arguments: list[str], desk: OpenFiles, token: str
) -> tuple[int, str]:
    """The exit code of a command and all that it prints. It ends when the editor cancels it."""
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(import_path for import_path in sys.path if import_path),
        "COLUMNS": "100",
        "NO_COLOR": "1",
    }
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-c", _COMMAND_LINE,
        stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.STDOUT, env=environment,
    )  # fmt: skip
    given = json.dumps({"arguments": arguments, "unsaved": desk.texts}).encode()
    answer = asyncio.ensure_future(process.communicate(given))
    cancelled = server.work_done_progress.tokens.get(token)
    while not answer.done():
        await asyncio.wait([answer], timeout=0.2)
        if cancelled is not None and cancelled.cancelled():
            with contextlib.suppress(ProcessLookupError):
                process.kill()
    said, _ = answer.result()
    return process.returncode or 0, said.decode("utf-8", "replace")


async def _show_output(server: LanguageServer, name: str, code: int, said: str) -> None:
    """Show what a command printed: as a document if the editor can, with a line about how it
    ended.
    """
    server.window_log_message(
        types.LogMessageParams(types.MessageType.Info, f"cellwright {name}\n{said}")
    )
    window = server.client_capabilities.window
    if window is not None and window.show_document is not None and window.show_document.support:
        folder = Path(tempfile.gettempdir()) / f"cellwright-{os.getpid()}"
        folder.mkdir(mode=0o700, exist_ok=True)
        page = folder / f"{name.replace(' ', '-')}.txt"
        page.write_text(said, "utf-8")
        await server.window_show_document_async(
            types.ShowDocumentParams(uri=page.as_uri(), take_focus=False)
        )
    lines = [line for line in said.splitlines() if line.strip()] or ["nothing was printed"]
    kind = types.MessageType.Info if code in (0, 10) else types.MessageType.Warning
    server.window_show_message(types.ShowMessageParams(kind, f"{name}: {lines[0].strip()}"))
