"""How long the language server takes to answer, and whether it survives random edits. Over the real
protocol.

    python benchmarks/language_server.py [--edits 10000] [--rounds 40] [--output FILE]

Latencies are those of an editor: from the request to the answer, each request right after an edit,
on a domain of about 2,000 lines. The time of the server's own process is told beside them: on a
busy machine only that is to be compared.
"""

import argparse
import json
import os
import queue
import random
import shutil
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from large_domain import written

TOP = Path(__file__).parents[1]
COMMAND = [sys.executable, "-c", "from cellwright.engine.faces.cli import main; main()", "lsp"]
PIECES = [
    "at(",
    "Item",
    ", ",
    "\n",
    "  - ",
    "{",
    "}",
    "[",
    '"',
    ":",
    "not ",
    "#",
    "é",
    "𝛼",
    "\t",
    "pick",
    "  x: y\n",
    "a..b",
]
TICK = os.sysconf("SC_CLK_TCK")


class Server:
    """A language server in a process, and the answers that it gives."""

    def __init__(self, root: Path, log: Path) -> None:
        environment = {**os.environ, "PYTHONPATH": str(TOP)}
        self.log = log
        with log.open("w") as said:
            self.process = subprocess.Popen(
                COMMAND, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=said, env=environment
            )
        self.answers: dict[int, queue.Queue[Any]] = {}
        self.told: queue.Queue[Any] = queue.Queue()
        self.count = 0
        threading.Thread(target=self._read, daemon=True).start()
        self.ask("initialize", {"processId": None, "rootUri": root.as_uri(), "capabilities": {}})
        self.tell("initialized", {})

    def _read(self) -> None:
        assert self.process.stdout is not None
        while line := self.process.stdout.readline():
            length = int(line.split(b":")[1])
            while self.process.stdout.readline().strip():
                pass
            message = json.loads(self.process.stdout.read(length))
            if "method" in message:
                self.told.put(message)
            else:
                self.answers[message["id"]].put(message)

    def _send(self, message: dict[str, Any]) -> None:
        assert self.process.stdin is not None
        body = json.dumps({"jsonrpc": "2.0", **message}).encode()
        self.process.stdin.write(b"Content-Length: %d\r\n\r\n%s" % (len(body), body))
        self.process.stdin.flush()

    def tell(self, method: str, params: Any) -> None:
        """Send a message that has no answer."""
        self._send({"method": method, "params": params})

    def ask(self, method: str, params: Any, seconds: float = 120) -> Any:
        """Send a request and wait for its answer.

        Raises `RuntimeError` for an error, except that a name cannot be changed.
        """
        self.count += 1
        self.answers[self.count] = queue.Queue()
        self._send({"id": self.count, "method": method, "params": params})
        answer = self.answers[self.count].get(timeout=seconds)
        del self.answers[self.count]
        if "error" in answer and answer["error"]["code"] != -32602:
            raise RuntimeError(f"{method}: {answer['error']['message']}")
        return answer.get("result")

    def spent_ms(self) -> float:
        """The processor time of the server's own process."""
        fields = Path(f"/proc/{self.process.pid}/stat").read_text().rpartition(")")[2].split()
        return 1000 * (int(fields[11]) + int(fields[12])) / TICK

    def end(self) -> int:
        """End the session; the exit code."""
        self.ask("shutdown", None)
        self.tell("exit", None)
        return self.process.wait(30)


def requests(uri: str, line: int, column: int) -> Iterator[tuple[str, dict[str, Any]]]:
    """Each kind of request, at a place."""
    document = {"textDocument": {"uri": uri}}
    at = {**document, "position": {"line": line, "character": column}}
    yield from (
        (f"textDocument/{name}", at)
        for name in ("hover", "completion", "definition", "documentHighlight")
    )
    yield "textDocument/references", {**at, "context": {"includeDeclaration": True}}
    yield "textDocument/rename", {**at, "newName": "renamed"}
    yield "textDocument/documentSymbol", document
    yield "textDocument/codeLens", document
    yield "textDocument/formatting", {**document, "options": {"tabSize": 2, "insertSpaces": True}}
    whole = {"start": {"line": 0, "character": 0}, "end": {"line": line, "character": column}}
    yield "textDocument/codeAction", {**document, "range": whole, "context": {"diagnostics": []}}
    yield "workspace/symbol", {"query": "re"}


def latencies(rounds: int) -> dict[str, Any]:
    """The time from each request to its answer on a domain of about 2,000 lines, each right
    after an edit of one character.
    """
    folder = Path(tempfile.mkdtemp())
    path = written(folder)
    text, uri, chance = path.read_text(), path.as_uri(), random.Random(1)
    server = Server(folder, folder / "log.txt")
    opened = {"uri": uri, "languageId": "yaml", "version": 1, "text": text}
    server.tell("textDocument/didOpen", {"textDocument": opened})
    for each in requests(uri, 1, 1):  # the first answers read all files
        server.ask(*each)
    waited, spent = defaultdict[str, list[float]](list), defaultdict[str, list[float]](list)
    lines = text.split("\n")
    for number in range(rounds):
        line = chance.randrange(len(lines))
        column = chance.randrange(len(lines[line]) + 1)
        for method, params in requests(uri, line, column):
            edit(server, uri, number, line, column, column, "x" if number % 2 else "")
            before, begin = server.spent_ms(), time.perf_counter()
            server.ask(method, params)
            waited[method].append(1000 * (time.perf_counter() - begin))
            spent[method].append(server.spent_ms() - before)
    log = (folder / "log.txt").read_text()
    code = server.end()
    shutil.rmtree(folder)
    every = [each for found in waited.values() for each in found]
    used = [each for found in spent.values() for each in found]
    return {
        "lines": len(lines),
        "load": os.getloadavg()[0],
        "waited_ms": {name: summary(found) for name, found in [*waited.items(), ("all", every)]},
        "processor_ms": {name: summary(found) for name, found in [*spent.items(), ("all", used)]},
        "tracebacks": log.count("Traceback"),
        "exit_code": code,
    }


def summary(found: list[float]) -> dict[str, float]:
    """Median and 95th percentile."""
    return {
        "median": round(statistics.median(found), 1),
        "p95": round(statistics.quantiles(found, n=20)[-1], 1),
    }


def edit(
    server: Server, uri: str, version: int, line: int, start: int, end: int, text: str
) -> None:
    """Send one change of a text."""
    span = {"start": {"line": line, "character": start}, "end": {"line": line, "character": end}}
    change = {
        "textDocument": {"uri": uri, "version": version},
        "contentChanges": [{"range": span, "text": text}],
    }
    server.tell("textDocument/didChange", change)


def survived(edits: int) -> dict[str, Any]:
    """How many random edits of the files of a bundled domain the server survives, with a random
    request after each.
    """
    folder = Path(tempfile.mkdtemp())
    shutil.copytree(TOP / "domains" / "themse", folder / "themse")
    names = (
        "domain.yaml",
        "rules.lp",
        "problems/two.yaml",
        "faults.yaml",
        "cell.yaml",
        "contacts.yaml",
    )
    files = [folder / "themse" / each for each in names]
    server, chance = Server(folder, folder / "log.txt"), random.Random(7)
    for each in files:
        opened = {
            "uri": each.as_uri(),
            "languageId": "yaml",
            "version": 0,
            "text": each.read_text(),
        }
        server.tell("textDocument/didOpen", {"textDocument": opened})
    begin = time.perf_counter()
    for number in range(edits):
        path = chance.choice(files)
        uri, line = path.as_uri(), chance.randrange(220)
        start = chance.randrange(60)
        text = "".join(chance.choices(PIECES, k=chance.randrange(3)))
        edit(server, uri, number + 1, line, start, start + chance.randrange(8), text)
        if number % 1000 == 999:
            print(f"{number + 1} edits", file=sys.stderr, flush=True)
        if number % 500 == 499:  # begin again: a text that is only noise asks for little
            whole = {
                "textDocument": {"uri": uri, "version": number + 1},
                "contentChanges": [{"text": path.read_text()}],
            }
            server.tell("textDocument/didChange", whole)
        server.ask(*chance.choice(list(requests(uri, chance.randrange(220), chance.randrange(60)))))
    seconds = time.perf_counter() - begin
    alive = server.process.poll() is None
    code = server.end()
    log = (folder / "log.txt").read_text()
    shutil.rmtree(folder)
    return {
        "edits": edits,
        "seconds": round(seconds, 1),
        "alive": alive,
        "exit_code": code,
        "tracebacks": log.count("Traceback"),
    }


def main() -> None:
    """Measure, print and keep the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--edits", type=int, default=10_000)
    parser.add_argument("--rounds", type=int, default=40)
    parser.add_argument("--output", type=Path)
    given = parser.parse_args()
    found: dict[str, Any] = {}
    if given.rounds:
        found["latencies"] = latencies(given.rounds)
    if given.edits:
        found["random_edits"] = survived(given.edits)
    print(json.dumps(found, indent=1))
    if given.output:
        given.output.write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
