"""A page as Chromium shows it, driven over its own protocol: no console, no network, no help."""

import base64
import json
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.request import urlopen

from websockets.sync.client import connect

BINARY = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("chrome")
_OPENS_S = 30.0


class Tab:
    """One page; what it logs and asks of the network is kept."""

    def __init__(self, socket: Any, console: bool) -> None:
        self._socket, self._number = socket, 0
        self.console: list[str] = []
        self.requests: dict[str, str] = {}
        self.refused: dict[str, str] = {}
        for domain in ("Page", "Network", *(("Runtime", "Log") if console else ())):
            self.call(f"{domain}.enable")

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """One command; what happened meanwhile is noted."""
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters}
        self._socket.send(json.dumps(message))
        while True:
            told = json.loads(self._socket.recv(timeout=_OPENS_S))
            if told.get("id") == self._number:
                assert "error" not in told, told
                return told["result"]
            self._note(told)

    def open(self, where: Path | str, width: int, height: int, **media: str) -> None:
        """Load a page in a window of a size, with media features such as a dark scheme."""
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height,
                  deviceScaleFactor=1, mobile=False)  # fmt: skip
        features = [{"name": k.replace("_", "-"), "value": v} for k, v in media.items()]
        self.call("Emulation.setEmulatedMedia", features=features)
        self.call("Page.navigate", url=where if isinstance(where, str) else where.as_uri())
        until = time.monotonic() + _OPENS_S
        while self.run("document.readyState") != "complete":
            assert time.monotonic() < until, "the page does not load"
            time.sleep(0.02)

    def run(self, script: str) -> Any:
        """The value of an expression in the page."""
        told = self.call("Runtime.evaluate", expression=script, returnByValue=True)
        assert "exceptionDetails" not in told, told
        return told["result"].get("value")

    def picture(self) -> bytes:
        """What is on the screen, as PNG."""
        return base64.b64decode(self.call("Page.captureScreenshot")["data"])

    def printed(self) -> bytes:
        """The page on A4, as PDF."""
        told = self.call("Page.printToPDF", preferCSSPageSize=True, printBackground=True)
        return base64.b64decode(told["data"])

    def _note(self, told: dict[str, Any]) -> None:
        method, what = told.get("method"), told.get("params", {})
        if method == "Network.requestWillBeSent":
            self.requests[what["requestId"]] = what["request"]["url"]
        elif method == "Network.loadingFailed":
            self.refused[what["requestId"]] = what.get("blockedReason", what["errorText"])
        elif method == "Runtime.consoleAPICalled" or method == "Runtime.exceptionThrown":
            self.console.append(json.dumps(what)[:300])
        elif method == "Log.entryAdded":
            self.console.append(what["entry"]["text"])


@contextmanager
def tab(*flags: str, console: bool = True) -> Iterator[Tab]:
    """A page of a Chromium that may speak to nobody but us."""
    # its helpers write to the profile for a moment longer than it lives
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        process = subprocess.Popen(
            [BINARY, "--headless=new", "--no-sandbox", *(flags or ["--disable-gpu"]),
             "--hide-scrollbars",
             "--remote-debugging-port=0", "--remote-allow-origins=*", "--no-first-run",
             "--disable-background-networking", "--disable-component-update",
             "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
             f"--user-data-dir={folder}", "about:blank"],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        try:
            told = Path(folder) / "DevToolsActivePort"
            until = time.monotonic() + _OPENS_S
            while not told.exists() or not told.read_text().strip():
                assert time.monotonic() < until and process.poll() is None, "no Chromium"
                time.sleep(0.05)
            port = int(told.read_text().split()[0])
            with urlopen(f"http://127.0.0.1:{port}/json/list", timeout=_OPENS_S) as answer:
                pages = [p for p in json.load(answer) if p["type"] == "page"]
            with connect(pages[0]["webSocketDebuggerUrl"], max_size=None) as socket:
                yield Tab(socket, console)
        finally:
            process.terminate()
            process.wait(10)
