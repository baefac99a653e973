# SPDX-License-Identifier: BSD-3-Clause
"""In the guest: checks what the last life left, runs a box on the disk, captures, and writes down what the box tells of, until the power goes.

power_cut_client.py STATE_DIR TOLD_FILE [look]: with `look` it only checks."""

import contextlib
import hashlib
import json
import pathlib
import socket
import sqlite3
import subprocess
import sys
import time

state, told_file = pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2])


def digest(document: dict) -> str:
    own = {key: value for key, value in document.items() if key not in ("id", "session")}
    return hashlib.sha256(json.dumps(own, sort_keys=True).encode()).hexdigest()


def check() -> str:
    """Of each line told, what is in the files."""
    flights, calibrations, whole = 0, 0, {}
    for line in told_file.read_text().splitlines() if told_file.exists() else []:
        told = json.loads(line)
        path = state / "sessions" / f"{told['session']:06d}.throwcal"
        with contextlib.closing(sqlite3.connect(path)) as database:
            if path not in whole:
                whole[path] = database.execute("PRAGMA integrity_check").fetchall()
                assert whole[path] == [("ok",)], (path, whole[path])
            if "flights" in told:
                kept = dict(database.execute("SELECT camera, count(*) FROM flight GROUP BY camera").fetchall())
                assert all(kept.get(i, 0) >= count for i, count in enumerate(told["flights"])), (told, kept)
                flights = flights + 1
            else:
                number = told["calibration"] % 10000
                newest = database.execute("SELECT max(number) FROM calibration").fetchone()[0]
                row = database.execute("SELECT document FROM calibration WHERE number = ?", (number,)).fetchone()
                assert row and digest(json.loads(row[0])) == told["digest"] or newest and newest >= number + 20, told
                calibrations = calibrations + 1
    return f"{flights} tellings of flights and {calibrations} calibrations hold, {len(whole)} files whole"


class Box:
    """JSON-RPC, an object a line."""

    def __init__(self, port: int):
        self.socket = socket.create_connection(("127.0.0.1", port))
        self.lines = self.socket.makefile("rb")
        self.lines.readline()

    def answer(self, method: str, **params) -> dict:
        self.socket.sendall(json.dumps({"jsonrpc": "2.0", "id": 1, "method": method, "params": params}).encode() + b"\n")
        return json.loads(self.lines.readline())


def tell(out, **what) -> None:
    """On the host at once: /host writes through."""
    out.write(json.dumps(what) + "\n")
    out.flush()


print("checked:", check(), flush=True)
if "look" in sys.argv:
    sys.exit(0)
port_file = pathlib.Path("/run/port")
subprocess.Popen(["./throwcald", "--config", "rig.toml", "--listen", "127.0.0.1:0", "--port-file", port_file, "--state-dir", state])
while not port_file.exists() or not port_file.read_text().strip():
    time.sleep(0.05)
box = Box(int(port_file.read_text()))
assert "result" in box.answer("auth", token=(state / "token").read_text().strip())
last, last_id = None, None
with told_file.open("a") as out:
    while True:
        status = box.answer("status.get")["result"]
        counts = [camera["flights"] for camera in status["cameras"]]
        if status["session"] and counts != last:
            last = counts
            tell(out, session=status["session"], flights=counts)
        if status["state"] in ("idle", "done"):
            box.answer("capture.start")
        latest = box.answer("calibration.latest").get("result")
        if latest and latest["id"] != last_id:
            last_id = latest["id"]
            tell(out, session=latest["session"], calibration=last_id, digest=digest(latest))
        time.sleep(0.02)
