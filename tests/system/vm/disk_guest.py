# SPDX-License-Identifier: BSD-3-Clause
"""In the guest: a box whose disk fills up, fails and is read-only. Prints what the box says of each; exits 0 where it survived all."""

import json
import os
import pathlib
import signal
import socket
import subprocess
import sys
import time

MOUNT = pathlib.Path("/run/disk")
STATE, PORT_FILE, IMAGE = MOUNT / "state", pathlib.Path("/run/port"), pathlib.Path("/run/disk.img")
SECTORS = 24 * 2048  # of 512 bytes


def run(*command: str) -> str:
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()


def device_is(table: str) -> None:
    """What lies behind /dev/mapper/disk from now on; what is on its way meets the new one."""
    run("dmsetup", "suspend", "--noflush", "--nolockfs", "disk")
    run("dmsetup", "load", "disk", "--table", f"0 {SECTORS} {table}")
    run("dmsetup", "resume", "disk")


class Box:
    """A throwcald, and a connection to it."""

    def __init__(self, log):
        PORT_FILE.unlink(missing_ok=True)
        command = ["./throwcald", "--config", "rig.toml", "--listen", "127.0.0.1:0", "--port-file", PORT_FILE, "--state-dir", STATE]
        self.process = subprocess.Popen(command, stderr=log)
        until(lambda: PORT_FILE.exists() and PORT_FILE.read_text().strip(), "the box is there")
        self.socket = socket.create_connection(("127.0.0.1", int(PORT_FILE.read_text())))
        self.lines = self.socket.makefile("rb")
        self.lines.readline()
        assert "result" in self.answer("auth", token=(STATE / "token").read_text().strip())

    def answer(self, method: str, **params) -> dict:
        self.socket.sendall(json.dumps({"jsonrpc": "2.0", "id": 1, "method": method, "params": params}).encode() + b"\n")
        return json.loads(self.lines.readline())

    def status(self) -> dict:
        return self.answer("status.get")["result"]

    def flights(self) -> int:
        return sum(camera["flights"] for camera in self.status()["cameras"])

    def stop(self) -> None:
        self.process.send_signal(signal.SIGTERM)
        assert self.process.wait(60) == 0, self.process.returncode


def until(condition, what: str):
    for _ in range(6000):
        if value := condition():
            return value
        time.sleep(0.05)
    raise AssertionError(f"it did not happen: {what}")


def a_full_disk(box: Box) -> None:
    box.answer("capture.start", until="stopped")
    before = until(box.flights, "a flight is found")
    filler = MOUNT / "filler"
    with filler.open("wb") as out:
        try:
            while True:
                out.write(bytes(4096))
                out.flush()
        except OSError:
            pass
    fault = until(lambda: box.status()["fault"], "the full disk is told")
    assert "full" in fault, fault
    told = box.flights()
    pathlib.Path(filler).unlink()
    until(lambda: box.status()["fault"] is None, "the disk has room again")
    after = until(lambda: (n := box.flights()) > told and n, "what waited is stored")
    print(f'full disk: "{fault}"; {before} flights before, {told} while it was full, {after} after it', flush=True)
    box.answer("capture.stop")
    until(lambda: box.status()["state"] == "done", "the session is solved")


def a_failing_disk(box: Box) -> None:
    session = box.answer("capture.start", until="stopped")["result"]["session"]
    told = until(box.flights, "a flight is found")
    device_is("error")
    fault = until(lambda: box.status()["fault"], "the failing disk is told")
    state, told = box.status()["state"], box.flights()
    assert state in ("warming-up", "capturing", "throw-seen"), state
    print(f'failing disk: "{fault}"; state {state}, {told} flights', flush=True)
    box.stop()
    device_is("linear /dev/loop0 0")
    run("umount", str(MOUNT))
    subprocess.run(["e2fsck", "-fy", "/dev/mapper/disk"], stdout=subprocess.DEVNULL)
    run("mount", "-t", "ext4", "/dev/mapper/disk", str(MOUNT))
    with open("out/log", "ab") as log:
        again = Box(log)
        assert again.status()["session"] == session and again.flights() >= told, again.status()
        until(lambda: again.status()["state"] == "done", "what was told is solved after all")
        print(f"after it: session {session} is back with {again.flights()} flights", flush=True)
        again.stop()


def a_read_only_disk() -> None:
    run("mount", "-o", "remount,ro", str(MOUNT))
    with open("out/log", "ab") as log:
        box = Box(log)
        fault = until(lambda: box.status()["fault"], "the read-only disk is told")
        until(lambda: box.status()["state"] == "fault", "nothing can be captured")
        refusal = box.answer("capture.start")["error"]["message"]
        assert "fault" in refusal, refusal
        states = [session["state"] for session in box.answer("session.list")["result"]]
        assert states == ["done", "done"], f"what is there can be read: {states}"
        run("mount", "-o", "remount,rw", str(MOUNT))
        until(lambda: box.status()["state"] == "idle", "it is writable again")
        assert "result" in box.answer("capture.start")
        print(f'read-only disk: "{fault}"; start: "{refusal}"', flush=True)
        box.stop()


MOUNT.mkdir()
with IMAGE.open("wb") as image:
    image.truncate(SECTORS * 512)
run("mke2fs", "-qF", "-t", "ext4", str(IMAGE))
for module in ("loop", "dm-mod"):
    run("modprobe", module)
run("losetup", "/dev/loop0", str(IMAGE))
run("dmsetup", "create", "disk", "--table", f"0 {SECTORS} linear /dev/loop0 0")
until(pathlib.Path("/dev/mapper/disk").exists, "the device is there")
run("mount", "-t", "ext4", "/dev/mapper/disk", str(MOUNT))
os.environ["PATH"] += ":/sbin:/usr/sbin"
with open("out/log", "ab") as first_log:
    the_box = Box(first_log)
    a_full_disk(the_box)
    a_failing_disk(the_box)
a_read_only_disk()
sys.exit(0)
