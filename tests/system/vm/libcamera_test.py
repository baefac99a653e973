#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Our libcamera cameras on libcamera's virtual pipeline, both of Debian 13: compiled there, run in its userland on its kernel. The pipeline
has no pace and leaves a buffer's metadata as memory was, so the counters are compared with a script that is preloaded in its place
(libcamera_script.cpp); pictures, stamps, buffers and requests are libcamera's own."""
import collections
import json
import pathlib
import subprocess
import sys
import time

import vm

TARGETS = ("grab", "cameras", "libcamera_script", "libcamera_controls")
ROUNDS = (1, 2, 3, 5, 8, 13, 21, 34, 55, 89)
FRAMES = 125  # of each of two cameras
EXPOSURE_US = 8000

CAMERAS = """
"one":
  supported_formats:
  - width: 160
    height: 120
    frame_rates: [30, 60]
  - width: 320
    height: 240
    frame_rates: [30]
  test_pattern: "bars"
  model: "First"
"two":
  supported_formats:
  - width: 160
    height: 120
    frame_rates: [30]
  test_pattern: "lines"
  model: "Second"
"""

SCRIPT = f"""
set -e
mkdir -p /usr/share/libcamera/pipeline/virtual
cp virtual.yaml /usr/share/libcamera/pipeline/virtual/
grab() {{ # OUT SCRIPT ARGUMENT...
  local out=out/$1 script=$2; shift 2
  LIBCAMERA_LOG=$out.driver LIBCAMERA_SCRIPT="$script" LD_PRELOAD=./liblibcamera_script.so ./grab "$@" times=$out.frames > $out.log 2>&1
}}
./cameras cameras --json > out/cameras
./cameras cameras > out/cameras.text
./libcamera_controls > out/controls
for source in libcamera:nobody libcamera:7 libcamera:; do ./grab 160x120 1 $source > out/error.$source 2>&1 || true; done
./grab 162x120 1 libcamera:one > out/error.size 2>&1 || true
./grab 160x120 1 format=YUYV libcamera:one > out/error.format 2>&1 || true
./grab 160x120 1 libcamera:one libcamera:0 > out/error.twice 2>&1 || true
./grab 160x120 20 frames={FRAMES} fps=30 times=out/alone.frames libcamera:one > out/alone.log 2>&1
./grab 160x120 20 frames=20 colour=1 libcamera:one > out/colour.log 2>&1
grab counted "fps=30 first=-30 lose=10 damage=8 exposure_us={EXPOSURE_US}" 160x120 60 frames={FRAMES} fps=30 libcamera:0 libcamera:two
grab whole "fps=30" 160x120 60 frames={FRAMES} libcamera:one
grab lost "fps=30 gone=30 nostart=3 starve=80 refuse=120" 160x120 60 frames=110 libcamera:one
rm /usr/share/libcamera/pipeline/virtual/virtual.yaml
./grab 160x120 1 libcamera: > out/error.none 2>&1 || true
cp virtual.yaml /usr/share/libcamera/pipeline/virtual/
./grab 160x120 60 rounds={",".join(map(str, ROUNDS * 2))} libcamera:one libcamera:two > out/matrix.log 2>&1
"""


class Run:
    """One call of grab: its counters by camera, its frames, and what the script told it."""

    def __init__(self, result: vm.Result, name: str) -> None:
        lines = result.text(f"{name}.log").splitlines()
        self.counters = [json.loads(line) for line in lines if line.startswith("{")]
        self.said = [line for line in lines if not line.startswith("{")]
        self.frames = collections.defaultdict(list)  # by source: (sequence, middle of exposure ns)
        for line in result.text(f"{name}.frames").splitlines():
            camera, sequence, stamp, _, _ = line.split()
            self.frames[camera].append((int(sequence), int(stamp)))
        self.driver = collections.defaultdict(list)  # by libcamera's id: (sequence, status, stamp ns)
        for line in result.files.get(f"{name}.driver", b"").decode().splitlines():
            camera, *numbers = line.split()
            self.driver[camera].append(tuple(map(int, numbers)))


def intervals_ms(frames: list[tuple[int, int]]) -> list[float]:
    return sorted((b[1] - a[1]) / 1e6 for a, b in zip(frames, frames[1:]))


def check_alone(result: vm.Result) -> None:
    """What the pipeline itself says: stamps that rise, and nothing else that could be believed."""
    run = Run(result, "alone")
    (counted,) = run.counters
    frames = run.frames["libcamera:one"]
    steps = intervals_ms(frames)
    print(f"  the pipeline alone: {len(frames)} frames, {steps[0]:.2f} to {steps[-1]:.2f} ms apart where 33.3 were asked for; {counted}", flush=True)
    assert len(frames) + counted["damaged"] >= FRAMES and counted["error"] == "" and counted["interruptions"] == 0, counted
    (coloured,) = map(json.loads, result.text("colour.log").splitlines())
    assert counted["levels"] == coloured["levels"] and coloured["levels"][0] < 40 and coloured["levels"][1] > 200, (counted, coloured)
    assert coloured["frames"] >= 20 and coloured["damaged"] == 0, coloured
    assert steps[0] > 0 and counted["timestamps"] == "start of exposure", (steps[0], counted)


def check_counted(result: vm.Result) -> None:
    """Losses, a counter that wraps, damage, stamps: ours against what the script told."""
    run = Run(result, "counted")
    for counted, (source, camera) in zip(run.counters, (("libcamera:0", "one"), ("libcamera:two", "two")), strict=True):
        frames, told = run.frames[source], run.driver[camera]
        whole = [(sequence, stamp) for sequence, status, stamp in told if status == 0]
        told = told[: 1 + told.index((*whole[len(frames) - 1][:1], 0, whole[len(frames) - 1][1]))]
        damaged = sum(status != 0 for _, status, _ in told)
        steps = [(b[0] - a[0]) % 2**32 for a, b in zip(told, told[1:])]
        lost = sum(steps) - len(steps)
        print(f"  {source}: {len(frames)} frames, {lost} lost, {damaged} damaged: counted {counted['lost']}, {counted['damaged']}", flush=True)
        assert told[0][0] > 2**31 > told[-1][0], "the counter wraps"
        assert lost > 5 and damaged > 3 and len(frames) >= FRAMES, (lost, damaged, len(frames))
        # grab ends in the midst of frames: the camera may have counted a few more.
        assert lost <= counted["lost"] <= lost + 3 and damaged <= counted["damaged"] <= damaged + 3, (counted, lost, damaged)
        assert counted["dropped"] == counted["interruptions"] == 0 and counted["error"] == "", counted
        first = whole[0][0]
        expected = [((sequence - first) % 2**32, stamp + EXPOSURE_US * 500) for sequence, stamp in whole[: len(frames)]]
        assert [(sequence - frames[0][0], time) for sequence, time in frames] == expected, f"{source}: not the camera's numbers and stamps"
        assert counted["timestamps"] == "start of exposure", counted
    whole = Run(result, "whole")
    (counted,) = whole.counters
    assert counted["lost"] == counted["damaged"] == counted["dropped"] == 0, counted
    assert [sequence for sequence, _ in whole.frames["libcamera:one"]] == list(range(counted["frames"])), "every frame is there"


def check_lost(result: vm.Result) -> None:
    run = Run(result, "lost")
    (counted,) = run.counters
    print(f"  lost and found: {run.said}; {counted}", flush=True)
    assert counted["interruptions"] == 3 and counted["error"] == "" and counted["frames"] >= 110, (counted, run.said)
    for cause in ("one: was unplugged", "one: no frame for 2 s", "one: queueRequest: Input/output error", "is back"):
        assert any(line == f"libcamera:one: {cause}" for line in run.said), (cause, run.said)
    assert run.said[-1].endswith("is back"), run.said


def check_errors(result: vm.Result) -> None:
    known = 'expected one of 0 "one", 1 "two"'
    for name, message in (
        ("libcamera:nobody", f'libcamera has no camera "nobody"; {known}'),
        ("libcamera:7", f'libcamera has no camera "7"; {known}'),
        ("libcamera:", f"libcamera has several cameras; {known}"),
        ("size", "one: gives pictures of 320x240-NV12; the rig says 162x120; in NV12 there are 160x120"),
        ("format", "one: gives NV12; expected YUYV"),
        ("twice", "one: is used by another: Device or resource busy"),
        ("none", "libcamera has no camera here; `throwcal cameras` lists what there is"),
    ):
        text = result.text(f"error.{name}")
        assert text.startswith("grab: camera libcamera:") and message in text and text.count("\n") == 1, (name, text)


def check_listing(result: vm.Result) -> None:
    cameras = json.loads(result.text("cameras"))
    assert [(c["source"], c["card"], c["driver"], c["problem"]) for c in cameras] == [
        ("libcamera:one", "First", "libcamera", None),
        ("libcamera:two", "Second", "libcamera", None),
    ], cameras
    assert [f["pixel_format"] for f in cameras[0]["formats"]] == ["NV12"] and cameras[0]["formats"][0]["usable"], cameras
    text = result.text("cameras.text")
    assert text.count('source = "libcamera:') == 2 and "NV12 160x120" in text, text
    assert result.text("controls").splitlines() == [
        "nothing asked: automatic off",
        "automatic:",
        "rate: frames of 33333 to 33333 us automatic off",
        "rate beyond: frames of 16667 to 16667 us automatic off",
        "exposure and gain: frames of 16667 to 16667 us automatic off exposure 2000 us gain 4",
        "of a camera without: exposure_s = 0.002: the camera has no such control",
        "gain beyond: gain = 100: the camera goes from 1 to 16",
    ], result.text("controls")


def check_matrix(result: vm.Result) -> None:
    rounds = [json.loads(line) for line in result.text("matrix.log").splitlines()]
    assert len(rounds) == 2 * 2 * len(ROUNDS), result.text("matrix.log")
    for counted, frames in zip(rounds, [n for n in ROUNDS * 2 for _ in range(2)]):
        assert counted["error"] == "" and counted["frames"] >= frames and counted["interruptions"] == 0, (counted, frames)
    files, kb = [r["files"] for r in rounds[1::2]], [r["resident_kb"] for r in rounds[1::2]]
    print(
        f"  started and stopped {len(files)} times: open files {files[0]} -> {files[-1]}, resident kB {kb[0]} -> {kb[len(ROUNDS) - 1]} -> {kb[-1]}",
        flush=True,
    )
    assert files[-1] <= files[0] and kb[-1] < kb[len(ROUNDS) - 1] + 1000, (files, kb)


def main() -> None:
    vm.need_image(13, "--libcamera")
    folder, began = pathlib.Path(sys.argv[sys.argv.index("--build") + 1]) / "debian13", time.monotonic()
    compiled = subprocess.run([vm.HERE / "compile", folder, *TARGETS], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    if compiled.returncode == 77:
        vm.skip(compiled.stdout.strip())
    assert compiled.returncode == 0, compiled.stdout
    print(f"compiled on Debian 13: {time.monotonic() - began:.0f} s", flush=True)
    names = {target: f"lib{target}.so" if target.endswith("script") else target for target in TARGETS}
    files = {name: folder / "tests" / name for name in names.values()}
    result = vm.run_in_guest(13, files | {"virtual.yaml": CAMERAS}, SCRIPT, 400, ("--libcamera", "--icount"))
    print(f"kernel 13: {result.total_s:.0f} s", flush=True)
    said = {name: result.text(name)[-2000:] for name in result.files if name.endswith(".log")}
    assert result.rc == 0, f"exit status {result.rc}\n{result.output}\n{said}"
    for check in (check_listing, check_errors, check_alone, check_counted, check_lost, check_matrix):
        check(result)


if __name__ == "__main__":
    main()
