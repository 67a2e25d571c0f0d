"""An interpreter of behaviour trees, as BehaviorTree.CPP 4 ticks them. It knows what exported trees
use.

Sequences remember where they are. A parallel asks its children in order, each until it has
succeeded; one that is skipped is asked again. `_skipIf` is asked when a node is idle, `_onSuccess`
runs when it succeeds. One node after another is ticked.
"""

import re
from collections.abc import Callable, Mapping
from enum import Enum
from xml.etree import ElementTree


class Status(Enum):
    """What a tick of a node gives."""

    RUNNING = "running"
    SUCCESS = "success"
    FAILURE = "failure"
    SKIPPED = "skipped"


Action = Callable[[Mapping[str, str]], Status]


class Tree:
    """A behaviour tree. `act` is called at each tick of an action, with its attributes."""

    def __init__(self, text: str, act: Action) -> None:
        root = ElementTree.fromstring(text.partition("\n")[2])
        assert (root.tag, root.get("BTCPP_format")) == ("root", "4")
        trees = {each.get("ID"): each for each in root.findall("BehaviorTree")}
        (self.top,) = list(trees[root.get("main_tree_to_execute")])
        self.models = {
            each.get("ID"): {port.get("name") for port in each}
            for each in root.findall("TreeNodesModel/*")
        }
        self.act = act
        self.board: dict[str, bool] = {}
        self.running: set[ElementTree.Element] = set()
        self.done: dict[ElementTree.Element, set[int]] = {}

    def tick(self) -> Status:
        """Tick the tree once."""
        return self._tick(self.top)

    def _tick(self, node: ElementTree.Element) -> Status:
        if (
            node not in self.running
            and "_skipIf" in node.attrib
            and self._holds(node.attrib["_skipIf"])
        ):
            return Status.SKIPPED
        self.running.add(node)
        status = {
            "Sequence": self._sequence,
            "Parallel": self._parallel,
            "Script": self._script,
        }.get(node.tag, self._leaf)(node)
        if status is not Status.RUNNING:
            self.running.discard(node)
        if status is Status.SUCCESS:
            self._run(node.get("_onSuccess", ""))
        return status

    def _sequence(self, node: ElementTree.Element) -> Status:
        done = self.done.setdefault(node, set())
        for place, child in enumerate(node):
            if place not in done:
                status = self._tick(child)
                if status is not Status.SUCCESS:
                    assert status is not Status.SKIPPED, "a sequence would go on without it"
                    return status
                done.add(place)
        return Status.SUCCESS

    def _parallel(self, node: ElementTree.Element) -> Status:
        done, skipped = self.done.setdefault(node, set()), 0
        assert (int(node.attrib["success_count"]), node.get("failure_count")) == (len(node), "1")
        for place, child in enumerate(node):
            if place in done:
                continue
            match self._tick(child):
                case Status.SUCCESS:
                    done.add(place)
                case Status.FAILURE:
                    return Status.FAILURE
                case Status.SKIPPED:
                    skipped += 1
            if len(done) == len(node):
                return Status.SUCCESS
        return Status.SKIPPED if skipped == len(node) else Status.RUNNING

    def _script(self, node: ElementTree.Element) -> Status:
        self._run(node.attrib["code"])
        return Status.SUCCESS

    def _leaf(self, node: ElementTree.Element) -> Status:
        if node.tag == "AlwaysSuccess":
            return Status.SUCCESS
        assert node.tag == "Action", f"BehaviorTree.CPP has no {node.tag}"
        ports = {
            name for name in node.attrib if name not in ("ID", "name") and not name.startswith("_")
        }
        assert ports <= self.models[node.get("ID")], "a port that its model does not have"
        return self.act(node.attrib)

    def _holds(self, condition: str) -> bool:
        flags = re.fullmatch(r"!\((.+)\)", condition)
        assert flags, condition
        return not all(self.board[each] for each in flags[1].split(" && "))

    def _run(self, code: str) -> None:
        for each in filter(None, code.split("; ")):
            name, _, value = each.partition(":=")
            self.board[name] = {"true": True, "false": False}[value]
