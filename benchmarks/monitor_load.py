"""A long run watched by one page and many clients: how late events come, whether one is lost, and
what memory server and page take.

    python benchmarks/monitor_load.py [--steps 10000] [--rate 100] [--clients 9]

A process writes the journal of a run at the given rate; each record says when it was written. The
clients read the stream of events, as other programs do. The page is opened in Chromium, if
Playwright and Chromium are there. Needs the extra `monitor`.
"""

import argparse
import asyncio
import json
import multiprocessing
import os
import shutil
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import httpx

from cellwright.kb.store.journal import Journal, JournalLine

QUIET = ("--no-sandbox", "--disable-background-networking", "--disable-component-update")


def written(store: str, steps: int, rate: float) -> None:
    """Write the journal of a run of so many steps, three records a step."""
    plan = [
        {
            "id": n,
            "step": f"pick(item_{n})",
            "stream": f"arm_{n % 4}",
            "start_ms": 1000 * n,
            "lasts_ms": 900,
        }
        for n in range(1, steps + 1)
    ]
    with Journal(store) as journal:
        journal.append(
            "long", [JournalLine(1, 0, "run", {}), JournalLine(2, 0, "plan", _plan(plan))]
        )
        begun, number = time.time(), 2
        for step in plan:
            for kind, content in _records(step):
                number += 1
                due = begun + (number - 2) / rate
                time.sleep(max(0.0, due - time.time()))
                now = {**content, "written": time.time()}
                journal.append(
                    "long", [JournalLine(number, 1000 * int(str(step["id"])), kind, now)]
                )


def _plan(steps: list[dict[str, Any]]) -> dict[str, Any]:
    end = 1000 * (len(steps) + 1)
    return {
        "why": "first",
        "forecast_ms": end,
        "goals": ["done(all)"],
        "given_up": [],
        "steps": steps,
        "order": [],
    }


def _records(step: dict[str, Any]) -> list[tuple[str, dict[str, Any]]]:
    number, action = step["id"], step["step"]
    command = {
        "command": number,
        "command_kind": "step",
        "stream": step["stream"],
        "action": action,
        "says": "",
        "lasts_ms": 900,
        "step": number,
    }
    facts = {"adds": [f"held(item_{number})"], "ends": [f"held(item_{number - 1})"]}
    done = {
        "step": number,
        "command": number,
        "action": action,
        "started_ms": 1000 * number,
        **facts,
    }
    return [("command", command), ("reply", {"command": number, "text": "done"}), ("done", done)]  # fmt: skip


async def client(address: str, last: int, delays: list[float]) -> list[int]:
    """Read the stream of events up to the record `last`; the numbers that came."""
    numbers = []
    async with (
        httpx.AsyncClient(timeout=None, trust_env=False) as web,
        web.stream("GET", f"{address}/events/long") as answer,
    ):
        async for line in answer.aiter_lines():
            if line.startswith("data: "):
                event = json.loads(line[6:])
                numbers.append(event["number"])
                if "written" in event:
                    delays.append(time.time() - event["written"])
                if event["number"] >= last:
                    break
    return numbers


def processor_s(process: int) -> float:
    """The processor time that a process has taken, in seconds."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def resident_mb(process: int) -> float:
    """The memory of a process in megabytes."""
    pages = int(Path(f"/proc/{process}/statm").read_text().split()[1])
    return pages * 4096 / 1e6


async def page(address: str, ended: asyncio.Event, heap: list[float], nodes: list[int]) -> None:
    """Keep the page of the run open, and note what its script takes, in megabytes, and how many
    elements it has.
    """
    chromium = shutil.which("chromium")
    try:
        from playwright.async_api import async_playwright
    except ImportError:
        return
    if chromium is None:
        return
    async with async_playwright() as player:
        browser = await player.chromium.launch(executable_path=chromium, args=list(QUIET))
        opened = await browser.new_page(viewport={"width": 1280, "height": 720})
        await opened.goto(f"{address}/run/long", timeout=120_000)
        session = await opened.context.new_cdp_session(opened)
        while not ended.is_set():
            await asyncio.sleep(5.0)
            await session.send("HeapProfiler.collectGarbage")
            used = await session.send("Runtime.getHeapUsage")
            heap.append(used["usedSize"] / 1e6)
            nodes.append(await opened.evaluate("document.querySelectorAll('*').length"))
        await browser.close()


async def measured(
    store: str, address: str, server: int, steps: int, rate: float, clients: int
) -> dict[str, Any]:
    """Watch the run from its beginning to its end."""
    ended, heap, nodes, memory = asyncio.Event(), list[float](), list[int](), list[float]()
    delays: list[list[float]] = [[] for _ in range(clients)]
    watching = asyncio.create_task(page(address, ended, heap, nodes))
    await asyncio.sleep(5.0)
    before_s = processor_s(server)
    writer = multiprocessing.get_context("spawn").Process(target=written, args=(store, steps, rate))
    writer.start()
    last = 2 + 3 * steps
    readers = [asyncio.create_task(client(address, last, each)) for each in delays]
    while not all(each.done() for each in readers):
        await asyncio.sleep(5.0)
        memory.append(resident_mb(server))
    taken_s = processor_s(server) - before_s
    ended.set()
    await watching
    came = [each.result() for each in readers]
    every = sorted(one for each in delays for one in each)
    return {
        "records": last,
        "lost or doubled": sum(numbers != list(range(1, last + 1)) for numbers in came),
        "delay ms, median": round(1000 * statistics.median(every), 1),
        "delay ms, 95 %": round(1000 * every[int(0.95 * len(every))], 1),
        "server, processor ms for a record": round(1000 * taken_s / last, 2),
        "server MB, after a quarter, half, all": _at_quarters(memory),
        "page MB, after a quarter, half, all": _at_quarters(heap),
        "elements of the page, after a quarter, half, all": _at_quarters(nodes),
    }


def _at_quarters(values: Sequence[float]) -> list[float]:
    """What was measured after a quarter, after a half and at the end."""
    return (
        [round(values[int(q * (len(values) - 1))], 1) for q in (0.25, 0.5, 1.0)] if values else []
    )


def main() -> None:
    """Measure, and print."""
    asked = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    asked.add_argument("--steps", type=int, default=10_000)
    asked.add_argument("--rate", type=float, default=100.0)
    asked.add_argument("--clients", type=int, default=9)
    given = asked.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        store = str(Path(folder) / "runs.db")
        with Journal(store) as journal:
            journal.begin("long", "2026-11-22T00:00:00+00:00", {"factor": 1.0})
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        words = [
            sys.executable,
            "-m",
            "cellwright.engine.faces.cli",
            "monitor",
            "long",
            "--store",
            store,
            "--port",
            str(port),
        ]
        with subprocess.Popen(words, stdout=subprocess.DEVNULL) as server:
            address = f"http://127.0.0.1:{port}"
            for _ in range(600):
                with socket.socket() as trial:
                    if trial.connect_ex(("127.0.0.1", port)) == 0:
                        break
                time.sleep(0.1)
            found = asyncio.run(
                measured(store, address, server.pid, given.steps, given.rate, given.clients)
            )
            server.terminate()
    print(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
