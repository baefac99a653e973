# SPDX-License-Identifier: BSD-3-Clause
"""In the guest, where no journal runs: its socket, a throwcald whose standard error is told to be the journal, and what it sends."""

import json
import os
import socket
import subprocess
import threading
import time

os.makedirs("/run/systemd/journal")
journal = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
journal.bind("/run/systemd/journal/socket")
entries: list[dict[str, str]] = []


def listen() -> None:
    while text := journal.recv(65536).decode():
        entries.append(dict(line.split("=", 1) for line in text.splitlines()))


def until(condition, what: str):
    end = time.monotonic() + 120
    while time.monotonic() < end:
        if value := condition():
            return value
        time.sleep(0.02)
    raise AssertionError(f"never: {what}; {entries}")


def entry(text: str) -> dict[str, str]:
    return until(lambda: [e for e in entries if text in e.get("MESSAGE", "")], text)[0]


threading.Thread(target=listen, daemon=True).start()
with open("/run/stderr", "w+") as stderr:
    facts = os.fstat(stderr.fileno())
    box = subprocess.Popen(
        ["./throwcald", "--config", "rig.toml", "--listen", "127.0.0.1:0", "--port-file", "port", "--state-dir", "/run/journalled"],
        stderr=stderr,
        env={**os.environ, "JOURNAL_STREAM": f"{facts.st_dev}:{facts.st_ino}"},
    )
    until(lambda: os.path.exists("port"), "it listens")
    connection = socket.create_connection(("127.0.0.1", int(open("port").read())))
    token = open("/run/journalled/token").read().strip()
    for method, params in (("auth", {"token": "not-the-token"}), ("auth", {"token": token}), ("capture.start", {}), ("capture.stop", {})):
        connection.sendall(json.dumps({"jsonrpc": "2.0", "id": 1, "method": method, "params": params}).encode() + b"\n")
    began, ended, token_entry = entry("session 1 began"), entry("session 1 ended"), entry("a client showed a token")
    missing = entry('"east":')
    box.terminate()
    assert box.wait(120) == 0
    assert stderr.seek(0) == 0 and stderr.read() == "", "not twice"
assert began["THROWCAL_SESSION"] == ended["THROWCAL_SESSION"] == "1" and len(began["MESSAGE_ID"]) == 32, (began, ended)
assert began["MESSAGE_ID"] != ended["MESSAGE_ID"] and began["PRIORITY"] == "6", (began, ended)
assert token_entry["THROWCAL_CAUSE"] == "token" and token_entry["PRIORITY"] == "4" and "MESSAGE_ID" not in token_entry, token_entry
assert missing["THROWCAL_CAMERA"] == "east" and missing["THROWCAL_CAUSE"] == "camera east" and len(missing["MESSAGE_ID"]) == 32, missing
print(len(entries), "entries;", missing)
