#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Footage through real V4L2 devices (v4l2loopback): the ring's stamps are the writer's, no frame is lost, and throwcald makes of a
rendered scene's films a calibration, which is compared with the truth."""

import collections
import json
import math
import os
import pathlib
import subprocess
import sys
import tempfile

import vm

MODULE = "modprobe v4l2loopback devices={n} video_nr={nodes} max_buffers=8"
STAMPS = dict(width=640, height=480, fps=60)
ROUNDS, FRAMES = 10, 150  # of 64 frames that are played; of each camera that are looked at
BUFFERS = 8  # frames that may lie in a device when its reader comes, with that moment's stamps
FILM = dict(cameras=2, width=320, height=240, fps=30, throws=3)

STAMPS_SCRIPT = """
set -e
{module}
udevadm settle
for i in $(seq {rounds}); do cat footage; done > /dev/shm/footage
./loopback_player {width} {height} GREY {fps} {players} > out/written &
while [ ! -s out/written ]; do kill -0 $!; sleep 0.05; done
LD_PRELOAD=./liblog_buffers.so BUFFER_LOG=out/driver ./grab {width}x{height} 60 frames={enough} times=out/frames {devices} > out/log
kill %1 2> /dev/null || true
"""

FILM_SCRIPT = """
set -e
{module}
udevadm settle
./loopback_player {width} {height} GREY {fps} {players} > out/written &
while [ ! -s out/written ]; do kill -0 $!; sleep 0.05; done
./throwcald --config rig.toml --listen 127.0.0.1:0 --http-listen 127.0.0.1:0 --port-file port --state-dir state 2> out/throwcald.log &
while [ ! -s port ]; do kill -0 $!; sleep 0.05; done
host=127.0.0.1:$(cat port)
export THROWCAL_TOKEN=$(cat state/token)
until ./throwcal capture start --host $host > out/start 2>&1; do sleep 0.2; done
./throwcal watch --until-throws {throws} --timeout 120 --host $host > out/watch 2>&1 || true
./throwcal status --json --host $host > out/status
for task in /proc/$(pgrep -x throwcald)/task/*; do echo "$(cat $task/comm) $(cut -d ' ' -f 41 $task/stat)"; done > out/threads
./throwcal capture stop --host $host > out/stop 2>&1 || true
./throwcal fetch --host $host --output out/calibration.json > out/fetch 2>&1 || true
kill %2; wait %2
"""


def module(nodes: list[int]) -> str:
    return MODULE.format(n=len(nodes), nodes=",".join(map(str, nodes)))


def ring_keeps_the_writers_stamps(kernel: int, build: pathlib.Path, folder: pathlib.Path) -> None:
    nodes = [20, 21, 22, 23]
    size = STAMPS["width"] * STAMPS["height"]
    footage = folder / "footage"
    footage.write_bytes(b"".join(bytes([n]) * size for n in range(64)))
    files = {
        "loopback_player": build / "loopback_player",
        "grab": build / "grab",
        "liblog_buffers.so": build / "liblog_buffers.so",
        "footage": footage,
    }
    players = " ".join(f"/dev/video{n}=/dev/shm/footage+{7000 * n}" for n in nodes)
    script = STAMPS_SCRIPT.format(
        module=module(nodes),
        players=players,
        devices=" ".join(f"/dev/video{n}" for n in nodes),
        enough=FRAMES,
        rounds=ROUNDS,
        **STAMPS,
    )
    result = vm.run_in_guest(kernel, files, script, 900, ("--icount", "--memory", "2048"))
    assert result.rc == 0, result.output
    written = collections.defaultdict(list)
    for line in result.text("written").splitlines():
        device, _, stamp = line.split()
        written[device].append(int(stamp))
    read, dequeued, taken = collections.defaultdict(list), {}, {}
    for line in result.text("frames").splitlines():
        device, _, stamp, at, _ = line.split()
        read[device].append(int(stamp))
        taken[int(stamp)] = int(at)
    for line in result.text("driver").splitlines():
        _, _, _, stamp, _, at = line.split()
        dequeued[int(stamp)] = int(at)
    for device, stamps in read.items():
        live = stamps[BUFFERS:]
        index = {stamp: k for k, stamp in enumerate(written[device])}
        assert all(stamp in index for stamp in live), (device, [s for s in live if s not in index][:3])
        steps = [index[b] - index[a] for a, b in zip(live, live[1:])]
        assert set(steps) == {1}, (device, f"{sum(s - 1 for s in steps)} frames lost of {len(live)}", steps)
    counters = [json.loads(line) for line in result.text("log").splitlines()]
    assert all(c["dropped"] == 0 and c["error"] == "" for c in counters), counters
    waits = sorted((taken[s] - dequeued[s]) / 1e3 for s in taken if s in dequeued)
    print(
        f"kernel {kernel}: {sum(map(len, read.values()))} frames of 4 x {STAMPS['width']}x{STAMPS['height']} at {STAMPS['fps']}/s, stamps equal to the "
        f"nanosecond, none lost; dequeued to taken from the ring p50 {waits[len(waits) // 2]:.0f} us, p99 {waits[len(waits) * 99 // 100]:.0f} us "
        f"(the guest's time)",
        flush=True,
    )


def with_calm_around(film: bytes, length: int) -> bytes:
    """The box starts while the film plays: its first half second over and over, before and after."""
    half_s = FILM["fps"] // 2 * FILM["width"] * FILM["height"]
    return film[:half_s] * 30 + film[:length] + film[:half_s] * 10


def a_film_becomes_a_calibration(kernel: int, build: pathlib.Path, folder: pathlib.Path) -> None:
    site = folder / "site"
    options = [str(word) for key, value in FILM.items() for word in (f"--{key}", value)]
    subprocess.run(
        [build.parent / "throwcal", "simulate", "--output", site, "--video", "--focal", "240", *options], check=True, stdout=subprocess.DEVNULL
    )
    truth = json.loads((site / "truth.json").read_text())
    names = [camera["name"] for camera in truth["cameras"]]
    nodes = [30 + i for i in range(len(names))]
    files, rig = {}, (site / "rig.toml").read_text()
    for name, node in zip(names, nodes):
        subprocess.run([build / "raw_frames", site / f"{name}.mkv", site / f"{name}.raw"], check=True)
        files[f"{name}.raw"] = site / f"{name}.raw"
        rig = rig.replace('source = "simulated"', f'source = "v4l2:/dev/video{node}"', 1)
    shortest = min(path.stat().st_size for path in files.values())
    for path in files.values():
        path.write_bytes(with_calm_around(path.read_bytes(), shortest))
    files |= {
        "loopback_player": build / "loopback_player",
        "throwcald": build.parent / "throwcald",
        "throwcal": build.parent / "throwcal",
        "rig.toml": rig,
    }
    players = " ".join(f"/dev/video{node}={name}.raw" for name, node in zip(names, nodes))
    script = FILM_SCRIPT.format(module=module(nodes), players=players, **FILM)
    result = vm.run_in_guest(kernel, files, script, 900, ("--icount", "--memory", "2048"))
    assert result.rc == 0 and "calibration.json" in result.files, result.output + str(
        {k: v[-2000:] for k, v in result.files.items() if k != "written"}
    )
    status, document = json.loads(result.text("status")), json.loads(result.text("calibration.json"))
    assert all(c["error"] is None and c["frames_dropped"] == 0 for c in status["cameras"]), status
    true = truth["cameras"][1]["T_world_cam"]["translation_m"]
    found = document["cameras"][1]["T_world_cam"]["translation_m"]
    covariance = document["cameras"][1]["covariance"]
    error_m = math.dist(true, found)
    sigma_m = math.sqrt(covariance[0] + covariance[6] + covariance[11])  # of the upper triangle's diagonal
    print(
        f"kernel {kernel}: {len(document['throws'])} throws, {document['verdict']}; the second camera is {1e3 * error_m:.1f} mm off, its own sigma {1e3 * sigma_m:.1f} mm "
        f"(of {math.dist(true, [0, 0, 0]):.2f} m)",
        flush=True,
    )
    round_robin = "2"  # SCHED_RR, in the kernel's stat
    policies = dict(line.rsplit(" ", 1) for line in result.text("threads").splitlines())
    first = {thread for thread, policy in policies.items() if policy == round_robin}
    assert first == {f"{name}.live" for name in names}, policies  # those that take frames go before all others, and nobody else does
    devices = [camera["device"] for camera in document["cameras"]]
    assert [d["mode"].split()[0] for d in devices] == ["320x240", "320x240"] and len({d["port"] for d in devices}) == 2, devices
    assert covariance and len(document["throws"]) >= 2 and error_m < min(0.1, 4 * sigma_m), (error_m, sigma_m, document, status)


def main() -> None:
    build = pathlib.Path(sys.argv[sys.argv.index("--build") + 1]) / "tests"
    for kernel in (12, 13) if os.environ.get("THROWCAL_LONG") else (12,):
        with tempfile.TemporaryDirectory() as folder:
            ring_keeps_the_writers_stamps(kernel, build, pathlib.Path(folder))
        with tempfile.TemporaryDirectory() as folder:
            a_film_becomes_a_calibration(kernel, build, pathlib.Path(folder))


if __name__ == "__main__":
    main()
