# SPDX-License-Identifier: BSD-3-Clause
"""A throwcald of one's own for a test: a simulated rig, a free port, a state folder, and whoever talks to it."""
import contextlib
import json
import os
import pathlib
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time

PATIENCE_S = 60  # for whatever must happen sooner or later; a loaded machine is slow


class Client:
    """One connection, JSON-RPC 2.0, an object a line."""

    def __init__(self, port: int):
        self.socket = socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S)
        self.lines = self.socket.makefile("rb")
        self.last_id = 0

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.lines.close()
        self.socket.close()

    def send(self, data: bytes) -> None:
        self.socket.sendall(data)

    def line(self) -> dict | list | None:
        """The next message, None where the box has closed."""
        text = self.lines.readline()
        return json.loads(text) if text else None

    def answer(self, method: str, params: dict | None = None) -> dict:
        """The whole answer to a request; notifications in between are left out."""
        self.last_id += 1
        request = {"jsonrpc": "2.0", "id": self.last_id, "method": method, "params": params or {}}
        self.send(json.dumps(request).encode() + b"\n")
        while (message := self.line()) is not None:
            if isinstance(message, dict) and message.get("id") == self.last_id:
                return message
        raise AssertionError(f"{method}: the box closed the connection")

    def call(self, method: str, params: dict | None = None):
        """The result of a method."""
        answer = self.answer(method, params)
        assert "result" in answer, f"{method}: {answer}"
        return answer["result"]

    def may_change(self, token: str) -> "Client":
        """Shows the box's token."""
        self.call("auth", {"token": token})
        return self


class Box:
    """A running throwcald. Stops with its context. `http`: its options for HTTP in place of those that any free port needs."""

    def __init__(self, build: pathlib.Path, folder: pathlib.Path, http: list | None = None, **environment: str):
        self.build, self.folder = build, folder
        self.notices = []
        self.log = open(folder / "log", "ab")
        notify_path = folder / "notify"
        notify_path.unlink(missing_ok=True)
        self.notify = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.notify.bind(str(notify_path))
        self.ready = threading.Event()
        threading.Thread(target=self.read_notices, daemon=True).start()  # as systemd does: unread, they would block the sender
        port_file, http_port_file = folder / "port", folder / "http_port"
        port_file.unlink(missing_ok=True)
        http_port_file.unlink(missing_ok=True)
        began = time.monotonic()
        any_http_port = ["--http-listen", "127.0.0.1:0"]
        self.process = subprocess.Popen(
            [build / "throwcald", "--config", folder / "rig.toml", "--listen", "127.0.0.1:0", "--state-dir", folder / "state",
             "--port-file", port_file, "--http-port-file", http_port_file, *(any_http_port if http is None else http)],
            stderr=self.log, env={**os.environ, "NOTIFY_SOCKET": str(notify_path), **environment})  # fmt: skip
        assert self.ready.wait(PATIENCE_S), "throwcald never said READY=1"
        self.start_s = time.monotonic() - began
        self.port = int(port_file.read_text())
        self.http_port = int(http_port_file.read_text()) if http_port_file.exists() else None
        self.token = (folder / "state" / "token").read_text().strip()

    def read_notices(self) -> None:
        with contextlib.suppress(OSError):
            while notice := self.notify.recv(4096):
                self.notices += notice.decode().split("\n")
                if b"READY=1" in notice.split(b"\n"):
                    self.ready.set()

    def stop(self) -> float:
        """SIGTERM; returns how long it took, asserts that it went well."""
        began = time.monotonic()
        self.process.send_signal(signal.SIGTERM)
        status = self.process.wait(PATIENCE_S)
        took = time.monotonic() - began
        self.close()
        assert status == 0, f"exit status {status}"
        return took

    def close(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()
        with contextlib.suppress(OSError):
            self.notify.shutdown(socket.SHUT_RDWR)
        self.notify.close()
        self.log.close()


@contextlib.contextmanager
def running_box(build: pathlib.Path, folder: pathlib.Path, http: list | None = None, **environment: str):
    box = Box(build, folder, http, **environment)
    try:
        yield box
    finally:
        box.close()


def simulate(build: pathlib.Path, folder: pathlib.Path, *options: str) -> None:
    """A simulated rig in `folder`."""
    subprocess.run([build / "throwcal", "simulate", "--output", folder, *options], check=True, stdout=subprocess.DEVNULL)


def until(condition, what: str):
    """Asks again until it holds; returns what it returned."""
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        if value := condition():
            return value
        time.sleep(0.02)
    raise AssertionError(f"not within {PATIENCE_S} s: {what}")


def main(story) -> None:
    """Runs a test's story(build, folder) in a folder of its own; exit status 0, 1, or 77 where the machine lacks something."""
    build = pathlib.Path(sys.argv[sys.argv.index("--build") + 1]).resolve()
    if not (build / "throwcald").exists():
        print("skipped: needs throwcald to be built")
        sys.exit(77)
    with tempfile.TemporaryDirectory() as folder:
        try:
            story(build, pathlib.Path(folder))
        except BaseException:
            log = pathlib.Path(folder) / "log"
            print("--- the box said:", log.read_text() if log.exists() else "nothing", "---", sep="\n", flush=True)
            raise
