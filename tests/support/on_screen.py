"""The words on rerun's screen, read as a screen reader would, and clicks."""

import json
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from wrenchbed.viewer import show


class Screen:
    """What can be read and clicked in a viewer, through its own server of tools (MCP)."""

    def __init__(self, process: subprocess.Popen) -> None:
        self._process, self._number = process, 0
        about = {"name": "tests", "version": "1"}
        self._ask("initialize", protocolVersion="2024-11-05", capabilities={}, clientInfo=about)
        self._tell({"method": "notifications/initialized"})

    def use(self, tool: str, **arguments: Any) -> Any:
        """What a tool answers."""
        told = self._ask("tools/call", name=tool, arguments=arguments)
        text = "".join(part.get("text", "") for part in told["content"])
        assert not told.get("isError"), text
        return json.loads(text) if text.startswith(("{", "[")) else text

    def words(self) -> str:
        """All that can be read now."""
        return "\n".join(_texts(self.use("widget_tree", limit=5000)))

    def show(self, tab: str, until: str) -> None:
        """Click what bears a text, and wait for another text."""
        self.use("click", content_contains=tab)
        self.use("wait_for", content_contains=until, timeout_secs=20)

    def _ask(self, method: str, **parameters: Any) -> dict[str, Any]:
        self._number += 1
        self._tell({"id": self._number, "method": method, "params": parameters})
        while True:
            told = json.loads(self._process.stdout.readline())
            if told.get("id") == self._number:
                assert "error" not in told, told["error"]
                return told["result"]

    def _tell(self, message: dict[str, Any]) -> None:
        self._process.stdin.write(json.dumps({"jsonrpc": "2.0"} | message) + "\n")
        self._process.stdin.flush()


@contextmanager
def screen(port: int) -> Iterator[Screen]:
    """The screen of a viewer that listens at a port."""
    with show.quiet() as environment:
        told = [show.command(None)[0], "viewer-mcp", "--endpoint", f"http://127.0.0.1:{port}"]
        process = subprocess.Popen(
            told, env=environment, text=True,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        try:
            yield Screen(process)
        finally:
            process.kill()
            process.communicate()


def _texts(node: Any) -> Iterator[str]:
    """Labels and values anywhere in a tree."""
    if isinstance(node, dict):
        yield from (str(node[k]) for k in ("label", "value") if node.get(k))
        for part in node.values():
            yield from _texts(part) if isinstance(part, dict | list) else ()
    elif isinstance(node, list):
        for part in node:
            yield from _texts(part)
