"""Rerun's page in a browser: drawn, served to this machine alone, and asking nobody else."""

import contextlib
import io
import socket
import subprocess
import sys
import threading
import time
from http.server import BaseHTTPRequestHandler, HTTPServer
from urllib.error import HTTPError
from urllib.parse import urlsplit
from urllib.request import urlopen

import numpy as np
import psutil
import pytest
from PIL import Image

import wrenchbed as wb
from chromium import BINARY, tab
from pictures import unless
from wrenchbed.errors import DriverError
from wrenchbed.viewer import show
from wrenchbed.viewer import show as page
from wrenchbed.viewer.elements import MEASURED, SIMULATED
from wrenchbed.viewer.recordings import recording_view

HERE = "127.0.0.1"
GL = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
DRAWS_S = 120.0


class Origin(BaseHTTPRequestHandler):
    """Serves a page that would ask others."""

    def do_GET(self):
        self.send_response(200 if self.path == "/" else 404)
        self.send_header("Content-Type", "text/html")
        self.end_headers()
        self.wfile.write(b'<link rel="icon" href="x.ico" /><link\n href="https://a.example/f" />')

    def log_message(self, *_):
        pass


@pytest.fixture
def origin():
    with HTTPServer((HERE, 0), Origin) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield server.server_port
        server.shutdown()


def test_the_page_comes_with_a_policy_and_without_links_elsewhere(origin):
    port = page.free_port()
    with page.served(port, origin), urlopen(f"http://{HERE}:{port}/") as answer:
        assert answer.headers["Content-Security-Policy"] == page.POLICY
        assert answer.read() == b'<link rel="icon" href="x.ico" />'
        with pytest.raises(HTTPError, match="404"):
            urlopen(f"http://{HERE}:{port}/none")
    asked = page.POLICY.split("connect-src")[1].split()
    assert asked == ["'self'", "http://127.0.0.1:*"]


def asked(port: int, head: str) -> bytes:
    """The answer to a request as it is."""
    quiet = contextlib.suppress(ConnectionError)
    with quiet, socket.create_connection((HERE, port), 5.0) as link:
        link.sendall(head.encode("latin-1"))
        return b"".join(iter(lambda: link.recv(65536), b""))
    return b""


def test_a_page_elsewhere_reads_nothing_and_a_target_stays_at_its_port(origin, tmp_path):
    shown = tmp_path / "secret.rrd"
    shown.write_bytes(b"secret")
    port = page.free_port()
    mine = f"Host: {HERE}:{port}\r\n"
    with page.served(port, origin // 10, shown):  # the last digit would reach another port
        for head, code in (
            (f"GET {origin % 10}/ HTTP/1.1\r\n{mine}\r\n", b"400"),
            (f"GET @{HERE}:{origin}/ HTTP/1.1\r\n{mine}\r\n", b"400"),
            (f"GET {page.FILE} HTTP/1.1\r\nHost: evil.example:{port}\r\n\r\n", b"403"),
            (f"GET {page.FILE} HTTP/1.1\r\n{mine}Origin: http://evil.example\r\n\r\n", b"403"),
            (f"GET {page.FILE} HTTP/1.1\r\n{mine}Sec-Fetch-Site: cross-site\r\n\r\n", b"403"),
            (f"POST {page.FILE} HTTP/1.1\r\n{mine}\r\n", b"405"),
            (f"GET {page.FILE} HTTP/1.1\r\n{mine}A: {'b' * 8200}\r\n\r\n", b"431"),
        ):
            answer = asked(port, head)
            assert answer.split(b" ")[1:2] == [code] and b"secret" not in answer, head
        own = f"{mine}Origin: http://{HERE}:{port}\r\n"
        answer = asked(port, f"GET {page.FILE} HTTP/1.1\r\n{own}\r\n")
        assert answer.endswith(b"\r\n\r\nsecret")


def test_silent_clients_are_limited_and_lock_nobody_out_for_long(origin):
    port = page.free_port()
    head = f"GET / HTTP/1.1\r\nHost: localhost:{port}\r\n\r\n"
    before = threading.active_count()
    with page.served(port, origin), contextlib.ExitStack() as stack:
        for _ in range(100):
            stack.enter_context(socket.create_connection((HERE, port), 5.0))
        assert asked(port, head) == b""
        assert threading.active_count() - before < 40
        stack.close()
        until = time.monotonic() + 5.0
        while not (answer := asked(port, head)) and time.monotonic() < until:
            time.sleep(0.05)
        assert answer.startswith(b"HTTP/1.0 200")


def test_ports_that_are_taken_are_named(origin):
    with pytest.raises(DriverError, match=f"{origin} is taken"), page.served(origin, 1):
        pass
    with (
        pytest.raises(DriverError, match=f"port {origin} is taken"),
        show.viewer(None, web=True, port=origin),
    ):
        pass


@pytest.mark.slow
def test_a_server_ends_with_its_command(tmp_path):
    shown = tmp_path / "v.rrd"
    shown.write_bytes(b"")
    ports = ["--port", str(page.free_port()), "--web-port", str(page.free_port())]
    command = [sys.executable, "-m", "wrenchbed", "view", str(shown), "--web", *ports]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline().startswith("open http://127.0.0.1:")
        (viewer,) = psutil.Process(process.pid).children()
        process.terminate()
        assert process.wait(10.0) == 0
        viewer.wait(5.0)


@unless(BINARY is not None, "chromium is not installed")
def test_a_browser_draws_the_recording_and_asks_nobody_else(tmp_path):
    robot = wb.load("robots", "ur5")
    with wb.SimDriver(wb.SimOptions("ur5", seed=1)) as driver:
        wb.record(driver, wb.poses(robot, 10, seed=1), tmp_path / "rec.parquet", samples=10)
    recording_view(wb.Recording.read(tmp_path / "rec.parquet"), tmp_path / "v.rrd")
    port, web_port = page.free_port(), page.free_port()
    with (
        show.viewer(tmp_path / "v.rrd", web=True, port=port, web_port=web_port) as viewer,
        tab(*GL, console=False) as browser,
    ):
        browser.open(show.address(web_port), 1280, 800)
        assert drawn(browser)
        worked = [sum(psutil.Process(viewer.pid).cpu_times()[:2])]
        time.sleep(2.0)
        worked.append(sum(psutil.Process(viewer.pid).cpu_times()[:2]))
        asked = {urlsplit(url).hostname for url in browser.requests.values()}
        ours = [*psutil.Process().net_connections("inet")]
        ours += psutil.Process(viewer.pid).net_connections("inet")
    assert asked == {HERE}
    assert worked[1] - worked[0] < 0.5  # of 2 s in which nothing happens
    listening = {c.laddr for c in ours if c.status == psutil.CONN_LISTEN}
    assert {(HERE, port), (HERE, web_port)} <= {tuple(a) for a in listening}
    assert {a.ip for a in listening} == {HERE}


def drawn(browser) -> bool:
    """Whether both colours are seen in time."""
    until = time.monotonic() + DRAWS_S
    while time.monotonic() < until:
        image = np.array(Image.open(io.BytesIO(browser.picture())).convert("RGB")).astype(int)
        seen = [(np.abs(image - c).max(axis=-1) < 40).sum() for c in (MEASURED, SIMULATED)]
        if min(seen) > 50:
            return True
        time.sleep(1.0)
    return False
