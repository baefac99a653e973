#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""The box is killed at random instants of running sessions: nothing that it told of is lost, and every file can be read.

20 times; 1,000 with THROWCAL_LONG=1. The seed is printed; THROWCAL_SEED repeats it (the instants, not what the machine was doing)."""

import contextlib
import hashlib
import json
import os
import pathlib
import random
import re
import sqlite3
import subprocess
import threading
import time

import box

KILLS = 1000 if os.environ.get("THROWCAL_LONG") else 20
WORKERS = 4  # boxes side by side
LATEST_KILL_S = 5.0  # after the start: it takes throws, calibrations and a solved session


class Told:
    """What the box has told of, over all its lives."""

    def __init__(self):
        self.flights: dict[int, list[int]] = {}  # a count each camera, by session
        self.calibrations: dict[int, str] = {}  # a document's digest, by id
        self.done: set[int] = set()

    def status(self, status: dict) -> None:
        session = status["session"]
        if session is None:
            return
        counts = [camera["flights"] for camera in status["cameras"]]
        self.flights[session] = [max(a, b) for a, b in zip(counts, self.flights.get(session, [0] * len(counts)))]
        if status["state"] == "done":
            self.done.add(session)

    def calibration(self, document: dict) -> None:
        self.calibrations[document["id"]] = digest(document)


def digest(document: dict) -> str:
    own = {key: value for key, value in document.items() if key not in ("id", "session")}
    return hashlib.sha256(json.dumps(own, sort_keys=True).encode()).hexdigest()


class Life:
    """A throwcald from its start to its sudden end, and a client that captures, looks and stops."""

    def __init__(self, build: pathlib.Path, folder: pathlib.Path, told: Told, dice: random.Random):
        self.told, self.folder = told, folder
        self.kill_after_s, self.stops = dice.uniform(0, LATEST_KILL_S), dice.random() < 0.5
        self.stop_after_s = dice.uniform(0, LATEST_KILL_S)
        self.port_file = folder / "port"
        self.port_file.unlink(missing_ok=True)
        self.log = open(folder / "log", "ab")
        command = [build / "throwcald", "--config", folder / "rig.toml", "--listen", "127.0.0.1:0", "--http-listen", "off", "--state-dir", folder / "state"]
        self.began = time.monotonic()
        self.process = subprocess.Popen([*command, "--port-file", self.port_file], stderr=self.log)
        self.is_killed = False

    def kill(self) -> None:
        self.is_killed = True
        self.process.kill()

    def live(self) -> None:
        timer = threading.Timer(self.kill_after_s, self.kill)
        timer.start()
        try:
            self.use()
        except (OSError, AssertionError, ValueError):
            if not self.is_killed:  # a refusal or a wrong answer, or the box has died by itself
                raise
        finally:
            timer.join()
            self.process.wait(box.PATIENCE_S)
            self.log.close()
        assert self.process.returncode == -9, f"it left by itself, with status {self.process.returncode}"

    def use(self) -> None:
        while not (self.port_file.exists() and (text := self.port_file.read_text()).strip()):
            if self.process.poll() is not None:
                return
            time.sleep(0.01)
        token = (self.folder / "state" / "token").read_text().strip()
        with box.Client(int(text)) as client:
            client.line()
            client.may_change(token)
            has_stopped, last_id = not self.stops, 0
            while self.process.poll() is None:
                status = client.call("status.get")
                self.told.status(status)
                if status["state"] in ("idle", "done"):
                    client.call("capture.start", {"until": "stopped"})
                elif not has_stopped and time.monotonic() - self.began > self.stop_after_s:
                    has_stopped = True
                    client.answer("capture.stop")
                latest = client.answer("calibration.latest").get("result")
                if latest and latest["id"] != last_id:
                    last_id = latest["id"]
                    self.told.calibration(latest)


def check(folder: pathlib.Path, told: Told) -> None:
    """Everything that was told of is in the files, each of which is whole."""
    files = {int(path.stem): path for path in (folder / "state" / "sessions").glob("*.throwcal")}
    for session, counts in told.flights.items():
        with contextlib.closing(sqlite3.connect(files[session])) as database:
            assert database.execute("PRAGMA integrity_check").fetchall() == [("ok",)], files[session]
            kept = dict(database.execute("SELECT camera, count(*) FROM flight GROUP BY camera").fetchall())
            assert all(kept.get(camera, 0) >= count for camera, count in enumerate(counts)), (session, counts, kept)
            state = database.execute("SELECT state FROM session").fetchone()[0]
            assert session not in told.done or state == "done", (session, state)
            documents = dict(database.execute("SELECT number, document FROM calibration").fetchall())
            for number in [n % 10000 for n in told.calibrations if n // 10000 == session]:
                if number > max(documents, default=0) - 20:  # older ones have made room
                    assert digest(json.loads(documents[number])) == told.calibrations[session * 10000 + number], (session, number)


def worker(build: pathlib.Path, folder: pathlib.Path, kills: int, seed: int, result: dict) -> None:
    dice, told = random.Random(seed), Told()
    try:
        for _ in range(kills):
            Life(build, folder, told, dice).live()
            recent = Told()  # of the older ones only the last life could have touched the newest
            newest = max(told.flights, default=0)
            recent.flights = {s: c for s, c in told.flights.items() if s >= newest - 1}
            recent.calibrations, recent.done = told.calibrations, told.done
            check(folder, recent)
        check(folder, told)
        result[seed] = told
    except BaseException as error:  # told by the main thread
        result[seed] = error


def story(build, folder) -> None:
    seed = int(os.environ.get("THROWCAL_SEED", time.time()))
    print(f"seed {seed}, {KILLS} kills", flush=True)
    result, threads = {}, []
    for i in range(WORKERS):
        site = folder / str(i)
        site.mkdir()
        box.simulate(build, site, "--cameras", "2", "--width", "320", "--height", "240", "--focal", "240", "--fps", "30", "--seed", str(i + 1))
        rig = site / "rig.toml"
        rig.write_text(re.sub("throw_interval_s = .*", "throw_interval_s = 2.0", rig.read_text()))
        threads.append(threading.Thread(target=worker, args=(build, site, KILLS // WORKERS, seed + i, result)))
        threads[-1].start()
    for thread in threads:
        thread.join()
    for told in result.values():
        if isinstance(told, BaseException):
            raise told
    flights = sum(sum(counts) for told in result.values() for counts in told.flights.values())
    assert flights > 0, "no life lasted until a flight was found"
    print(
        f"{KILLS} kills, {sum(len(t.flights) for t in result.values())} sessions, {sum(len(t.done) for t in result.values())} of them solved: {flights} flights and "
        f"{sum(len(t.calibrations) for t in result.values())} calibrations told of, none lost; every file whole"
    )
    for i in range(WORKERS):
        with box.running_box(build, folder / str(i)) as the_box, box.Client(the_box.port) as client:
            client.line()
            box.until(lambda: client.call("status.get")["state"] in ("done", "idle"), "it solves what was interrupted")
            problems = [s["problem"] for s in client.call("session.list") if "problem" in s]
            assert not problems, problems
            the_box.stop()


if __name__ == "__main__":
    box.main(story)
