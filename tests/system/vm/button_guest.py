# SPDX-License-Identifier: BSD-3-Clause
"""In the guest: a keyboard, a lamp and a beeper by uinput, lines by gpio-sim, and a throwcald that somebody presses the button of.
button_guest.py PATTERNS.json: by what README says of each state, the light's times on and off. Ends with an AssertionError or prints what it saw."""

import contextlib
import fcntl
import glob
import json
import os
import pathlib
import select
import shutil
import socket
import struct
import subprocess
import sys
import threading
import time

EV_SYN, EV_KEY, EV_LED, EV_SND, EV_REP = 0, 1, 0x11, 0x12, 0x14
KEY_RECORD, LED_SCROLLL, SND_TONE = 167, 2, 2
SET_EV, SET_KEY, SET_LED, SET_SND, SETUP, CREATE, DESTROY = 0x40045564, 0x40045565, 0x40045569, 0x4004556A, 0x405C5503, 0x5501, 0x5502
EVENT = struct.Struct("llHHi")
PATIENCE_S = 120  # the guest's own
STATE = pathlib.Path("/run/state")  # SQLite wants a file system that maps memory
GPIO = pathlib.Path("/sys/kernel/config/gpio-sim/box")
STEP_S = 0.06  # how much later than due a loaded guest may switch


class Device:
    """An input device until it is unplugged."""

    def __init__(self, name: str, bits: list[tuple[int, int]], events: list[int]):
        self.file = os.open("/dev/uinput", os.O_RDWR | os.O_NONBLOCK)
        for event in events:
            fcntl.ioctl(self.file, SET_EV, event)
        for request, bit in bits:
            fcntl.ioctl(self.file, request, bit)
        fcntl.ioctl(self.file, SETUP, struct.pack("HHHH80sI", 3, 1, 1, 1, name.encode(), 0))
        fcntl.ioctl(self.file, CREATE)
        self.folder = pathlib.Path(until(lambda: [f for f in glob.glob("/sys/class/input/input*") if self.is_named(f, name)], name)[0])
        self.node = "/dev/input/" + until(lambda: glob.glob(f"{self.folder}/event*"), name)[0].split("/")[-1]
        until(lambda: os.path.exists(self.node), self.node)

    @staticmethod
    def is_named(folder: str, name: str) -> bool:
        with contextlib.suppress(OSError):
            return pathlib.Path(folder, "name").read_text().strip() == name
        return False

    def key(self, value: int) -> None:
        os.write(self.file, EVENT.pack(0, 0, EV_KEY, KEY_RECORD, value) + EVENT.pack(0, 0, EV_SYN, 0, 0))

    def press(self) -> None:
        self.key(1)
        time.sleep(0.1)
        self.key(0)

    def unplug(self) -> None:
        fcntl.ioctl(self.file, DESTROY)
        os.close(self.file)

    def listen(self) -> "Device":
        """The kernel keeps 16 events only."""
        self.heard, self.tones = [], []
        threading.Thread(target=self.hear, daemon=True).start()
        return self

    def hear(self) -> None:
        while select.select([self.file], [], [])[0]:
            s, us, kind, _, value = EVENT.unpack(os.read(self.file, EVENT.size))
            if kind == EV_SND:
                self.tones.append(value)
            if kind == EV_LED:
                self.heard.append((s + us / 1e6, kind, value))

    def told(self) -> list[tuple[float, int, int]]:
        """What was written to it since the last time: when, type, value."""
        out, self.heard = self.heard, []
        return out


def keyboard() -> Device:
    return Device("button", [(SET_KEY, KEY_RECORD), (SET_KEY, 30)], [EV_KEY, EV_REP])


class Box:
    """A running throwcald, and one connection to it."""

    def __init__(self, panel: str):
        pathlib.Path("live.toml").write_text(pathlib.Path("rig.toml").read_text() + panel)
        pathlib.Path("port").unlink(missing_ok=True)
        self.log = open("out/throwcald.log", "a+")
        self.log.seek(0, 2)
        self.log_begin = self.log.tell()
        self.process = subprocess.Popen(
            ["./throwcald", "--config", "live.toml", "--listen", "127.0.0.1:0", "--port-file", "port", "--state-dir", STATE], stderr=self.log
        )
        self.connection = None
        until(lambda: os.path.exists("port") or self.process.poll() is not None, "the box listens")
        self.connection = socket.create_connection(("127.0.0.1", int(pathlib.Path("port").read_text())))
        self.lines = self.connection.makefile("rb")
        self.lines.readline()

    def call(self, method: str, **params) -> dict:
        self.connection.sendall(json.dumps({"jsonrpc": "2.0", "id": 1, "method": method, "params": params}).encode() + b"\n")
        return json.loads(self.lines.readline())

    def status(self) -> dict:
        return self.call("status.get")["result"]

    def is_forbidden(self, method: str) -> bool:
        return self.call(method).get("error", {}).get("code") == -32001

    def captures(self) -> bool:
        return self.status()["state"] in ("warming-up", "capturing", "throw-seen")

    def said(self, what: str) -> int:
        self.log.seek(self.log_begin)
        return self.log.read().count(what)

    def stop(self) -> None:
        self.process.terminate()
        assert self.process.wait(PATIENCE_S) == 0
        self.connection.close()


def until(condition, what: str):
    end = time.monotonic() + PATIENCE_S
    while time.monotonic() < end:
        if value := condition():
            return value
        time.sleep(0.02)
    raise AssertionError(f"never: {what}")


def lights_up_as(told: list[tuple[float, int, int]], steps_ms: list[int]) -> float:
    """Whether the lamp kept this rhythm, from some step on; the worst that it was off, in seconds."""
    switched = [(at, value != 0) for at, kind, value in told if kind == EV_LED]
    spans = [(b[0] - a[0], a[1]) for a, b in zip(switched, switched[1:])]
    steps = [(ms / 1000, i % 2 == 0) for i, ms in enumerate(steps_ms)]
    assert len(spans) >= len(steps) - 1, (spans, steps)
    best = 9.0
    for phase in range(len(steps)):
        turned = [steps[(phase + i) % len(steps)] for i in range(len(spans))]
        if all(span[1] == step[1] for span, step in zip(spans, turned)):
            best = min(best, max(abs(span[0] - step[0]) for span, step in zip(spans, turned)))
    assert best < STEP_S, (best, spans, steps)
    return best


OPEN = [50, 100, 50, 100, 50, 300]  # three flashes in between: anybody may change something


def watch(lamp: Device, steps_ms: list[int], s: float = 7.0) -> float:
    time.sleep(0.3)
    lamp.told()
    time.sleep(s)
    return lights_up_as(lamp.told(), steps_ms)


def begins_and_ends(box: Box, key: Device, lamp: Device, patterns: dict) -> None:
    assert box.status()["state"] == "idle" and box.is_forbidden("capture.start"), "before a press"
    worst = watch(lamp, patterns["idle"])
    key.press()
    until(box.captures, "a press begins")
    first = box.status()["session"]
    until(lambda: box.status()["state"] == "capturing", "warm")
    worst = max(worst, watch(lamp, patterns["capturing"] + [300] + OPEN))
    assert "result" in box.call("capture.stop"), "anybody may within a minute of a press"
    until(lambda: box.status()["state"] == "done", "solved")
    assert box.status()["verdict"] != "accepted", box.status()
    worst = max(worst, watch(lamp, patterns["done, not accepted"] + OPEN))
    print(f"the lamp's rhythms of idle, capturing and done, not accepted: off by {1000 * worst:.0f} ms at most")
    key.press()
    until(box.captures, "the next begins another")
    assert box.status()["session"] != first
    key.press()
    until(lambda: box.status()["state"] == "done", "and the next ends it")


def bounces(box: Box, key: Device) -> None:
    session = box.status()["session"]
    for value in (1, 0, 1, 0, 1):
        key.key(value)
        time.sleep(0.004)
    time.sleep(0.15)
    for value in (0, 1, 0, 1, 0):
        key.key(value)
        time.sleep(0.004)
    until(box.captures, "a train of bounces begins a session")
    time.sleep(1)
    assert box.captures() and box.status()["session"] != session
    print("a train of bounces is one press")


def aborts(box: Box, key: Device) -> None:
    assert box.captures()
    key.key(1)
    pressed = time.monotonic()
    while box.captures():
        assert time.monotonic() < pressed + PATIENCE_S
        key.key(2)  # autorepeat
        time.sleep(0.03)
    took = time.monotonic() - pressed
    assert took >= 3, took
    until(lambda: box.status()["state"] in ("idle", "done"), "over")
    key.key(0)
    time.sleep(1)
    assert not box.captures(), "its release is no press"
    print(f"held: aborted after {took:.2f} s, with autorepeat")


def unplugged(box: Box, key: Device) -> Device:
    before = box.status()["session"], box.status()["state"]
    key.key(1)
    time.sleep(0.5)
    key.unplug()
    until(lambda: box.said("was unplugged"), "it says so")
    time.sleep(4)
    assert (box.status()["session"], box.status()["state"]) == before, "what was pressed on it means nothing"
    key = keyboard()
    until(lambda: box.said('<6>button: "button"') == 2, "it is taken up again")
    key.press()
    until(box.captures, "it works again")
    print("unplugged while pressed, plugged in again: works again")
    return key


def window_closes(box: Box, key: Device) -> None:
    opened = time.monotonic()
    assert "result" in box.call("capture.stop")
    until(lambda: not box.is_forbidden("capture.start"), "still open")
    time.sleep(max(0.0, opened + 61 - time.monotonic()))
    assert box.is_forbidden("capture.stop") and box.is_forbidden("capture.start"), "a minute later"
    print("a write without a token: refused before a press, allowed within the minute, refused after it")


def beeps(tones: list[int]) -> None:
    assert tones and tones[-1] == 0 and all(on > 0 and off == 0 for on, off in zip(tones[::2], tones[1::2])), tones
    print(f"{len(tones) // 2} beeps: {sorted(set(tones) - {0})} Hz, each ends")


def with_keys(patterns: dict) -> None:
    lamp = Device("lamp", [(SET_LED, LED_SCROLLL), (SET_SND, SND_TONE)], [EV_LED, EV_SND]).listen()
    led = until(lambda: glob.glob(f"{lamp.folder}/input*::scrolllock"), "its LED")[0].split("/")[-1]
    panel = f'\n[button]\nkey = "KEY_RECORD"\ngrab = true\n[light]\nled = "{led}"\nbeep = "{lamp.node}"\n'
    box = Box(panel)
    until(lambda: box.said("no input device here with the key KEY_RECORD"), "it says that none is there")
    key = keyboard()
    until(lambda: box.said('<6>button: "button"'), "it is found")
    begins_and_ends(box, key, lamp, patterns)
    bounces(box, key)
    aborts(box, key)
    key = unplugged(box, key)
    window_closes(box, key)
    box.stop()
    assert pathlib.Path("/sys/class/leds", led, "brightness").read_text().strip() == "0", "off at the end"
    until(lambda: lamp.tones and lamp.tones[-1] == 0, "the last beep ends")
    beeps(lamp.tones)

    token = (STATE / "token").read_text()
    key.key(1)
    box = Box(panel)
    assert "result" in box.call("auth", token=token.strip())
    until(lambda: box.said("there is a new token"), "a factory reset")
    assert (STATE / "token").read_text() != token
    assert box.call("auth", token=token.strip())["error"]["code"] == -32001, "the old one is no more"
    assert box.call("auth", token=(STATE / "token").read_text().strip())["result"]
    key.key(0)
    time.sleep(1)
    assert not box.captures()
    assert box.call("session.list")["result"], "sessions stay"
    box.stop()
    key.unplug()
    print("held for 10 s since the start: a new token, the old one refused, sessions kept")


def holds_a_line(process: int) -> bool:
    files = []
    for file in glob.glob(f"/proc/{process}/fd/*"):
        with contextlib.suppress(OSError):
            files.append(os.readlink(file))
    return any("gpio" in file for file in files)


def with_lines(patterns: dict) -> None:
    subprocess.run(["modprobe", "gpio-sim"], check=True)
    subprocess.run(["mount", "-t", "configfs", "none", "/sys/kernel/config"], check=True)
    (GPIO / "bank").mkdir(parents=True)
    (GPIO / "bank" / "num_lines").write_text("8")
    (GPIO / "live").write_text("1")
    chip = (GPIO / "bank" / "chip_name").read_text().strip()
    lines = pathlib.Path("/sys/devices/platform", (GPIO / "dev_name").read_text().strip())

    def line(number: int, file: str) -> pathlib.Path:
        return lines / (GPIO / "bank" / "chip_name").read_text().strip() / f"sim_gpio{number}" / file

    def wire(level: str) -> None:
        line(3, "pull").write_text(f"pull-{level}")

    def press() -> None:
        for level in ("down", "up", "down"):
            wire(level)
            time.sleep(0.005)
        time.sleep(0.1)
        for level in ("up", "down", "up"):
            wire(level)
            time.sleep(0.005)

    wire("up")
    box = Box(f'\n[button]\ngpio = "{chip}:3"\nactive_low = true\npull = "up"\n[light]\ngpio = "{chip}:5"\n')
    told, before = [], None
    end = time.monotonic() + 7
    while time.monotonic() < end:
        if (now := line(5, "value").read_text().strip()) != before:
            told.append((time.monotonic(), EV_LED, int(now)))
            before = now
        time.sleep(0.005)
    worst = lights_up_as(told[1:], patterns["idle"])
    press()
    until(box.captures, "a press begins")
    time.sleep(1)
    assert box.captures(), "bounces are no more presses"
    press()
    until(lambda: box.status()["state"] == "done", "the next ends it")
    (GPIO / "live").write_text("0")
    until(lambda: box.said("is gone"), "it says that the chip is gone")
    until(lambda: not holds_a_line(box.process.pid), "it lets go of both lines")
    (GPIO / "live").write_text("1")
    back = (GPIO / "bank" / "chip_name").read_text().strip()
    if back != chip:  # 6.1 never frees the number of a chip that went away while a line was in use; a udev rule would name it
        os.symlink(f"/dev/{back}", f"/dev/{chip}")
        lines /= f"../{(GPIO / 'dev_name').read_text().strip()}"
    wire("up")
    until(lambda: box.said(f"button: {chip}:3\n") == 2, "it is taken up again")
    press()
    until(box.captures, "it works again")
    box.stop()
    print(f"GPIO lines: presses with bounces, the lamp's rhythm off by {1000 * worst:.0f} ms at most, a chip that went away and came back")


def main() -> None:
    patterns = json.loads(pathlib.Path(sys.argv[1]).read_text())
    subprocess.run(["modprobe", "-a", "uinput", "evdev"], check=True)
    with_lines(patterns)
    shutil.rmtree(STATE)
    with_keys(patterns)


if __name__ == "__main__":
    main()
