#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""A network that is not nice: clients that come and go by the thousand, that never read, that stop in the middle, beside 16 that ask all
the time. The box loses no frame, and neither memory nor descriptors. 1,000 connections; 10,000 with THROWCAL_LONG=1."""

import contextlib
import os
import pathlib
import socket
import struct
import threading

import box

CONNECTIONS = 10_000 if os.environ.get("THROWCAL_LONG") else 1_000
ASKING = 12  # of the 16 places; the others are for who comes and goes
MAX_GROWTH_KB = 2_000  # of the resident size, the second half against the first: pages, not clients


def resident_kb(pid: int) -> int:
    status = pathlib.Path(f"/proc/{pid}/status").read_text()
    return int(next(line.split()[1] for line in status.splitlines() if line.startswith("VmRSS")))


def descriptors(pid: int) -> int:
    return len(list(pathlib.Path(f"/proc/{pid}/fd").iterdir()))


def comes_and_goes(port: int, kind: int) -> None:
    """One client of each kind: well-bred, silent, in the middle of a line, oversize, a reader that never reads, a sudden end."""
    with contextlib.closing(socket.create_connection(("127.0.0.1", port), timeout=box.PATIENCE_S)) as client, contextlib.suppress(OSError):
        request = b'{"jsonrpc":"2.0","id":1,"method":"status.get"}\n'
        if kind == 0:
            client.sendall(request)
            reader = client.makefile("rb")
            reader.readline(), reader.readline()
        elif kind == 2:
            client.sendall(request[:20])
        elif kind == 3:
            client.sendall(b"x" * 100_000)
        elif kind == 4:
            client.sendall(request * 50)
        elif kind == 5:
            client.sendall(request)
            client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))  # a reset, not an end


class Asker(threading.Thread):
    """A client that asks all the time."""

    def __init__(self, port: int, over: threading.Event):
        super().__init__()
        self.port, self.over, self.questions, self.error = port, over, 0, None

    def run(self) -> None:
        try:
            with box.Client(self.port) as client:
                client.line()
                while not self.over.is_set():
                    client.call("status.get")
                    self.questions += 1
                    self.over.wait(0.05)
        except BaseException as error:  # told by the main thread
            self.error = error


def storm(port: int, connections: int) -> None:
    for i in range(connections):
        comes_and_goes(port, i % 6)


def counters(port: int) -> list[dict]:
    """As soon as there is a place."""

    def served():
        with box.Client(port) as client:
            return (client.line() or {}).get("method") == "hello" and client.call("status.get")["cameras"]

    return box.until(served, "a place is free")


def story(build, folder) -> None:
    box.simulate(build, folder, "--cameras", "2", "--width", "320", "--height", "240", "--focal", "240", "--fps", "30")
    with box.running_box(build, folder) as the_box:
        pid, over = the_box.process.pid, threading.Event()
        box.until(lambda: all(c["frames"] > 30 for c in counters(the_box.port)), "every camera runs")
        askers = [Asker(the_box.port, over) for _ in range(ASKING)]
        for asker in askers:
            asker.start()
        box.until(lambda: all(asker.questions or asker.error for asker in askers), "everyone has asked")
        silent = [socket.create_connection(("127.0.0.1", the_box.port)) for _ in range(2)]  # half open: they never say a word
        storm(the_box.port, CONNECTIONS // 2)
        box.until(lambda: descriptors(pid) <= 64 + ASKING, "who went is gone")
        middle, middle_files, before = resident_kb(pid), descriptors(pid), counters(the_box.port)
        storm(the_box.port, CONNECTIONS - CONNECTIONS // 2)
        box.until(lambda: descriptors(pid) <= middle_files + 2, "who went is gone, again")
        after, end = counters(the_box.port), resident_kb(pid)
        over.set()
        for each in [*askers, *silent]:
            each.join() if isinstance(each, threading.Thread) else each.close()
        lost = {key: sum(n[key] - w[key] for w, n in zip(before, after)) for key in ("frames_dropped", "frames_lost_by_driver")}
        print(
            f"{CONNECTIONS} connections beside {ASKING} clients with {sum(asker.questions for asker in askers)} questions: {sum(n['frames'] - w['frames'] for w, n in zip(before, after))} frames, {lost}; "
            f"resident {middle} -> {end} kB, {middle_files} -> {descriptors(pid)} descriptors"
        )
        for asker in askers:
            if asker.error:
                raise asker.error
        assert all(asker.questions for asker in askers), [asker.questions for asker in askers]
        assert not any(lost.values()), (before, after)
        assert end - middle < MAX_GROWTH_KB, (middle, end)
        the_box.stop()


if __name__ == "__main__":
    box.main(story)
