"""The server in a process of its own, as an editor starts it: the real protocol over standard
input and output.
"""

import json
import os
import queue
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("pygls")

from cellwright.kb.targets import BUNDLED_DOMAINS

TOP = Path(__file__).parents[4]
COMMAND = [
    sys.executable,
    "-c",
    "from cellwright.engine.faces.cli import main; main()",
    "lsp",
    "--stdio",
]
WINDOW = {"workDoneProgress": True, "showDocument": {"support": True}}


class Editor:
    """An editor: it starts a server, asks, and hears what it is told."""

    def __init__(self, root: Path, log: Path) -> None:
        self.log = log
        with log.open("w") as said:
            self.process = subprocess.Popen(
                COMMAND, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=said,
                cwd=root, env={**os.environ, "PYTHONPATH": str(TOP)},
            )  # fmt: skip
        self.answers: queue.Queue[Any] = queue.Queue()
        self.told: queue.Queue[Any] = queue.Queue()
        threading.Thread(target=self._read, daemon=True).start()
        self.capabilities = self.ask(
            "initialize",
            {"processId": None, "rootUri": root.as_uri(), "capabilities": {"window": WINDOW}},
        )["capabilities"]
        self.send({"method": "initialized", "params": {}})

    def _read(self) -> None:
        assert self.process.stdout is not None
        while line := self.process.stdout.readline():
            while self.process.stdout.readline().strip():
                pass
            message = json.loads(self.process.stdout.read(int(line.split(b":")[1])))
            if "method" not in message:
                self.answers.put(message)
            else:
                self.told.put(message)
                if "id" in message:
                    self.send({"id": message["id"], "result": {"success": True}})

    def send(self, message: dict[str, Any]) -> None:
        assert self.process.stdin is not None
        body = json.dumps({"jsonrpc": "2.0", **message}).encode()
        self.process.stdin.write(b"Content-Length: %d\r\n\r\n%s" % (len(body), body))
        self.process.stdin.flush()

    def ask(self, method: str, params: Any) -> Any:
        self.send({"id": 1, "method": method, "params": params})
        answer = self.answers.get(timeout=120)
        assert "error" not in answer, answer
        return answer["result"]

    def open(self, path: Path, text: str) -> None:
        document = {"uri": path.as_uri(), "languageId": "yaml", "version": 1, "text": text}
        self.send({"method": "textDocument/didOpen", "params": {"textDocument": document}})

    def change(self, path: Path, text: str) -> None:
        document = {"uri": path.as_uri(), "version": 2}
        params = {"textDocument": document, "contentChanges": [{"text": text}]}
        self.send({"method": "textDocument/didChange", "params": params})

    def diagnostics(self, path: Path, wanted: bool) -> list[Any]:
        """What is published about a file next that has findings, or none, as wanted."""
        while True:
            said = self.told.get(timeout=120)
            if (
                said["method"] == "textDocument/publishDiagnostics"
                and said["params"]["uri"] == path.as_uri()
            ):
                found: list[Any] = said["params"]["diagnostics"]
                if bool(found) == wanted:
                    return found

    def hear(self, method: str) -> Any:
        """The parameters of the next message of a kind."""
        while True:
            said = self.told.get(timeout=120)
            if said["method"] == method:
                return said["params"]

    def end(self) -> int:
        self.ask("shutdown", None)
        self.send({"method": "exit"})
        return self.process.wait(60)


@pytest.fixture(scope="module")
def editor(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Editor]:
    root = tmp_path_factory.mktemp("editor")
    shutil.copytree(BUNDLED_DOMAINS / "themse", root / "themse")
    made = Editor(root / "themse", root / "log.txt")
    yield made
    if made.process.poll() is None:
        made.process.kill()
        made.process.wait()
    for stream in (made.process.stdin, made.process.stdout):
        assert stream is not None
        stream.close()


@pytest.fixture
def cell(editor: Editor) -> Path:
    return editor.log.parent / "themse"


def test_an_edit_is_diagnosed_fixed_and_forgotten(editor: Editor, cell: Path) -> None:
    domain = cell / "domain.yaml"
    text = domain.read_text()
    wrong = text.replace("goal: inside(P, drawer)", "goal: insde(P, drawer)", 1)
    editor.open(domain, wrong)
    (found,) = editor.diagnostics(domain, True)
    assert found["code"] == "K101"
    action, *_ = editor.ask(
        "textDocument/codeAction",
        {
            "textDocument": {"uri": domain.as_uri()},
            "range": found["range"],
            "context": {"diagnostics": [found]},
        },
    )
    (edit,) = action["edit"]["changes"][domain.as_uri()]
    line = wrong.split("\n")[edit["range"]["start"]["line"]]
    span = slice(edit["range"]["start"]["character"], edit["range"]["end"]["character"])
    assert (line[span], edit["newText"]) == ("insde", "inside")
    editor.change(domain, text)
    assert editor.diagnostics(domain, False) == []


def test_every_ability_is_announced(editor: Editor) -> None:
    wanted = {
        "completionProvider", "hoverProvider", "definitionProvider", "referencesProvider", "renameProvider",
        "documentSymbolProvider", "workspaceSymbolProvider", "codeActionProvider", "codeLensProvider",
        "documentFormattingProvider", "documentHighlightProvider", "executeCommandProvider",
    }  # fmt: skip
    assert wanted <= set(editor.capabilities)
    assert editor.capabilities["codeActionProvider"]["codeActionKinds"] == ["quickfix"]


@pytest.mark.slow
def test_a_lens_plans_the_text_of_the_editor(editor: Editor, cell: Path) -> None:
    problem = cell / "problems" / "two.yaml"
    editor.open(problem, problem.read_text().replace("heated(P, 15 min), cooled(P, 5 min), ", ""))
    uri = problem.as_uri()
    lenses = editor.ask("textDocument/codeLens", {"textDocument": {"uri": uri}})
    assert [each["command"]["title"] for each in lenses] == ["plan", "run", "explain"]
    command = lenses[0]["command"]
    answer = editor.ask(
        "workspace/executeCommand",
        {"command": command["command"], "arguments": command["arguments"]},
    )
    assert answer["exit_code"] == 0, answer
    assert "heat(" not in answer["text"]  # what the editor has, not what is on the disk
    page = editor.hear("window/showDocument")["uri"]
    assert page.endswith("plan-two.txt")


def ordered(editor: Editor, path: Path, title: str) -> dict[str, Any]:
    """The request that the lens with a title above a file stands for."""
    lenses = editor.ask("textDocument/codeLens", {"textDocument": {"uri": path.as_uri()}})
    command = next(each["command"] for each in lenses if each["command"]["title"] == title)
    return {"command": command["command"], "arguments": command["arguments"]}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "title", "said"),
    [
        ("problems/in_furnace.yaml", "run", "all goals are reached"),
        ("problems/in_furnace.yaml", "explain", "there is a plan of 5 steps"),
        ("domain.yaml", "check", "no errors in"),
    ],
)
def test_every_lens_does_what_it_says(
    editor: Editor, cell: Path, name: str, title: str, said: str
) -> None:
    path = cell / name
    editor.open(path, path.read_text())
    answer = editor.ask("workspace/executeCommand", ordered(editor, path, title))
    assert answer["exit_code"] == 0, answer
    assert said in answer["text"]


@pytest.mark.slow
def test_a_lens_that_is_cancelled_ends_at_once(editor: Editor, cell: Path) -> None:
    path = cell / "domain.yaml"
    editor.open(path, path.read_text())
    request = ordered(editor, path, "check")
    while not editor.told.empty():
        editor.told.get()
    editor.send({"id": 1, "method": "workspace/executeCommand", "params": request})
    token = editor.hear("window/workDoneProgress/create")["token"]
    assert editor.hear("$/progress")["value"]["cancellable"]
    editor.send({"method": "window/workDoneProgress/cancel", "params": {"token": token}})
    answer = editor.answers.get(timeout=120)["result"]
    assert answer["exit_code"] == -9, answer
    assert answer["text"] == ""
    hover = {"textDocument": {"uri": path.as_uri()}, "position": {"line": 2, "character": 1}}
    assert editor.ask("textDocument/hover", hover)  # the server goes on


def test_a_name_of_a_device_leads_to_its_file_and_errors_there_are_told(
    editor: Editor, cell: Path
) -> None:
    device = cell / "devices" / "shaker" / "device.yaml"
    device.parent.mkdir(parents=True)
    text = (
        "device: shaker\nabout: shakes\nfluents:\n  shaken(probe): {weight: 3}\noperators:\n"
        "  $name(Probe):\n    preconditions: at(Probe, Place)\n    adds: shaken(Probe)\n"
    )
    device.write_text(text.replace("Place", "mars_gripper"))
    domain = cell / "domain.yaml"
    own = domain.read_text().replace("  freezer: {}", "  freezer: {}\n  shaker: {}")
    editor.open(domain, own)
    at = {"line": own[: own.index("shaker: {}")].count("\n"), "character": 4}
    asked = {"textDocument": {"uri": domain.as_uri()}, "position": at}
    (found,) = editor.ask("textDocument/definition", asked)
    assert found["uri"] == device.as_uri()
    editor.open(device, text.replace("at(Probe, Place)", "att(Probe, mars_gripper)"))
    (wrong,) = editor.diagnostics(device, True)
    assert (wrong["code"], wrong["range"]["start"]["line"]) == ("K101", 6)
    (used,) = wrong["relatedInformation"]
    assert (used["location"]["uri"], used["location"]["range"]["start"]["line"]) == (
        domain.as_uri(),
        at["line"],
    )
    editor.change(domain, domain.read_text())


def test_the_session_ends_with_its_processes(editor: Editor) -> None:
    """Runs last in this module."""
    children = Path(f"/proc/{editor.process.pid}/task/{editor.process.pid}/children")
    helpers = children.read_text().split() if children.exists() else []
    assert editor.end() == 0
    until = time.monotonic() + 60
    while left := [each for each in helpers if Path(f"/proc/{each}/exe").exists()]:
        assert time.monotonic() < until, left
        time.sleep(0.05)
    assert "Traceback" not in editor.log.read_text()
