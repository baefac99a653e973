#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Our V4L2 cameras on USB cameras, which the kernel's own uvcvideo drives: who they are, all frames with the driver's stamps, unplugging
under streaming, ports swapped. The cameras are usb_camera.cpp; whether it keeps its promises is seen here, too. THROWCAL_LONG=1: both
kernels and 200 times unplugged, else one and 5."""
import json
import os
import pathlib
import statistics
import sys

import vm
from vivid_test import Run, gaps

LONG = bool(os.environ.get("THROWCAL_LONG"))
KERNELS = (12, 13) if LONG else (13,)
FRAMES = 1500 if LONG else 150
CYCLES = 200 if LONG else 5
IDENTITIES = (("Acme", "Eye 300", "SN0042"), ("Other", "Cam X", ""))
LINK = "/dev/v4l/by-path/platform-vhci_hcd.0-usb-0:{}:1.0-video-index0"  # the kernel counts ports from 1
FIRST, SECOND = LINK.format(1), LINK.format(2)

SCRIPT = f"""
set -e
modprobe -a vhci-hcd uvcvideo
mkfifo /run/commands
exec 9<> /run/commands
./usb_camera {' '.join(f"'{','.join(identity)}'" for identity in IDENTITIES)} <&9 > out/usb.log 2>&1 &
usb=$!
await() {{ until eval "$1"; do kill -0 $usb; sleep 0.05; done; }}
here() {{ await "[ -e {FIRST} ] && [ -e {SECOND} ]"; udevadm settle; }}
gone() {{ await "! [ -e {FIRST} ] && ! [ -e {SECOND} ]"; }}
grab() {{ # OUT ARGUMENT...
  local out=out/$1; shift
  LD_PRELOAD=./liblog_buffers.so BUFFER_LOG=$out.driver exec ./grab "$@" times=$out.frames > $out.log 2>&1
}}
control() {{ v4l2-ctl --device {FIRST} "$@"; }}
picture() {{ control --set-fmt-video=width=320,height=240 --stream-mmap --stream-count=$2 --stream-to=out/$1 > out/$1.log 2>&1; }}

here
./throwcal cameras --json > out/cameras
for node in /sys/class/video4linux/video*; do
  for file in manufacturer product serial idVendor idProduct speed busnum; do
    [ ! -e $node/device/../$file ] || echo "$node/device/../$file = $(cat $node/device/../$file)"
  done
done > out/sysfs

(grab small 320x240 200 fps=30 frames={FRAMES} {FIRST} {SECOND})
(grab large 640x480 200 fps=15 frames={FRAMES // 5} {FIRST} {SECOND})

picture automatic 3
control --get-ctrl=exposure_time_absolute > out/wandered
control --set-ctrl=exposure_time_absolute=50 > out/refused 2>&1 || true
control --set-ctrl=auto_exposure=1,focus_automatic_continuous=0,white_balance_automatic=0
for exposure in 50 100 200; do control --set-ctrl=exposure_time_absolute=$exposure; picture exposure$exposure 2; done
control --set-ctrl=exposure_time_absolute=50,gain=64; picture gain64 2
control --list-ctrls > out/kept

grab plugged 320x240 20000 fps=30 {FIRST} {SECOND} &
grab=$!
rss() {{ grep VmRSS /proc/$grab/status | tr -dc 0-9; }}
back() {{ grep -c 'is back' out/plugged.log; }}
await "[ -s out/plugged.driver ]"
sleep 1
for n in $(seq {CYCLES}); do
  echo unplug 0 >&9
  await "[ \\$(grep -c 'was unplugged' out/plugged.log) = $n ]"
  echo plug 0 >&9
  await "[ \\$(back) = $n ]"
  [ $n != 3 ] || echo $(ls /proc/$grab/fd | wc -l) $(rss) > out/early
done
sleep 1
echo $(ls /proc/$grab/fd | wc -l) $(rss) > out/late
kill $grab
wait $grab
control --list-ctrls > out/fresh

echo unplug 0 >&9
echo unplug 1 >&9
gone
echo plug 0 1 >&9
echo plug 1 0 >&9
here
./throwcal cameras --json > out/swapped
exec 9>&-
"""


def check_listing(result: vm.Result) -> None:
    cameras = json.loads(result.text("cameras"))
    assert [c["card"] for c in cameras] == [model for _, model, _ in IDENTITIES], cameras
    for port, camera in enumerate(cameras, 1):
        assert camera["driver"] == "uvcvideo" and camera["by_path"] == LINK.format(port) and camera["problem"] is None, camera
        assert camera["bus"] == f"usb-vhci_hcd.0-{port}", camera
        (yuyv,) = camera["formats"]
        rates = {size["size"]: [round(rate) for rate in size["frames_per_s"]] for size in yuyv["sizes"]}
        assert yuyv["pixel_format"] == "YUYV" and rates == {"320x240": [30, 15], "640x480": [30, 15]}, camera
    swapped = {c["card"]: c["by_path"] for c in json.loads(result.text("swapped"))}
    assert swapped == {"Eye 300": SECOND, "Cam X": FIRST}, swapped
    said = result.text("sysfs")
    print("  " + said.rstrip().replace("\n", "\n  "), flush=True)
    for node, (manufacturer, model, serial) in zip((0, 2), IDENTITIES):
        told = {"manufacturer": manufacturer, "product": model, "idVendor": "1209", "idProduct": "0001", "speed": "480", "busnum": "1"}
        told |= {"serial": serial} if serial else {}
        lines = [line for line in said.splitlines() if f"/video{node}/" in line]
        assert sorted(lines) == sorted(f"/sys/class/video4linux/video{node}/device/../{file} = {text}" for file, text in told.items()), said


def check_frames(result: vm.Result) -> None:
    for name, frames_per_s in (("small", 30), ("large", 15)):
        run = Run(result, name)
        assert set(run.counters) == {FIRST, SECOND}, run.said
        for camera, counted in run.counters.items():
            check_undisturbed(run, camera)
            stamps = [stamp for _, stamp in run.frames[camera]]
            assert [answer[2] for answer in run.driver_of(camera)][: len(stamps)] == stamps, f"{name}: {camera}: not the driver's stamps"
            steps = [(after - before) / 1e6 for before, after in zip(stamps, stamps[1:])]
            print(f"  {name}: {len(stamps)} frames, {min(steps):.2f} to {max(steps):.2f} ms apart; sigma {counted['time_sigma_s'] * 1e6:.0f} us", flush=True)
            assert abs(statistics.median(steps) * frames_per_s / 1000 - 1) < 0.02, steps


def check_undisturbed(run: Run, camera: str) -> None:
    counted, sequences = run.counters[camera], [sequence for sequence, _ in run.frames[camera]]
    assert all(counted[what] == 0 for what in ("lost", "damaged", "dropped", "interruptions")) and counted["error"] == "", counted
    assert counted["timestamps"] == "start of exposure", counted
    assert sequences == list(range(sequences[0], sequences[0] + len(sequences))) and gaps(run.driver_of(camera)) == 0, sequences


def luma(result: vm.Result, name: str, width: int = 320) -> int:
    """Of the middle column, in the last picture's last line."""
    return result.files[name][-width]


def check_controls(result: vm.Result) -> None:
    lumas = {name: luma(result, name) for name in ("automatic", "exposure50", "exposure100", "exposure200", "gain64")}
    wandered, refused = result.text("wandered").strip(), result.text("refused").strip()
    print(f"  automatic: {wandered}; set all the same: {refused!r}; luma {lumas}", flush=True)
    assert int(wandered.split()[-1]) > 156 and "Permission denied" in refused, (wandered, refused)
    assert 100 <= lumas.pop("automatic") <= 131 and lumas == {"exposure50": 32, "exposure100": 64, "exposure200": 128, "gain64": 128}, lumas
    for name, exposure, gain in (("kept", 50, 64), ("fresh", 156, 16)):  # plugged anew, it knows nothing of before
        said = [line.split() for line in result.text(name).splitlines()]
        values = {words[0]: words for words in said if words}
        assert f"value={gain}" in values["gain"], values
        assert name == "fresh" or f"value={exposure}" in values["exposure_time_absolute"], values


def check_unplugging(result: vm.Result) -> None:
    run = Run(result, "plugged")
    early, late = ([int(word) for word in result.text(name).split()] for name in ("early", "late"))
    counted = run.counters[FIRST]
    print(f"  {CYCLES} times unplugged; {counted}; open files {early[0]} -> {late[0]}, resident kB {early[1]} -> {late[1]}", flush=True)
    assert counted["interruptions"] == CYCLES and counted["error"] == "" and counted["lost"] == counted["dropped"] == 0, counted
    assert run.said.count(f"{FIRST}: {FIRST}: was unplugged") == run.said.count(f"{FIRST}: is back") == CYCLES, run.said
    assert late[0] == early[0] and late[1] < early[1] + 2000, (early, late)
    check_undisturbed(run, SECOND)
    steps = [(b[1] - a[1]) / 1e6 for a, b in zip(run.frames[SECOND], run.frames[SECOND][1:])]
    print(f"  the other: {len(steps) + 1} frames, {min(steps):.2f} to {max(steps):.2f} ms apart", flush=True)


def main() -> None:
    build = pathlib.Path(sys.argv[sys.argv.index("--build") + 1])
    files = {name: build / "tests" / name for name in ("grab", "liblog_buffers.so", "usb_camera")} | {"throwcal": build / "throwcal"}
    for kernel in KERNELS:
        result = vm.run_in_guest(kernel, files, SCRIPT, 1500, ("--icount",))
        print(f"kernel {kernel}: {result.total_s:.0f} s", flush=True)
        said = {name: result.text(name)[-2000:] for name in result.files if name.endswith(".log")}
        assert result.rc == 0, f"exit status {result.rc}\n{result.output}\n{said}"
        for check in (check_listing, check_frames, check_controls, check_unplugging):
            check(result)


if __name__ == "__main__":
    main()
