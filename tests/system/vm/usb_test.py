#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Our V4L2 cameras on USB cameras, which the kernel's own uvcvideo drives: who they are, all frames with the driver's stamps, unplugging
under streaming, ports swapped. The cameras are usb_camera.cpp; whether it keeps its promises is seen here, too. THROWCAL_LONG=1: both
kernels and 200 times unplugged, else one and 5."""

import json
import os
import pathlib
import statistics
import subprocess
import sys
import tempfile

import vm
from vivid_test import Run, gaps

LONG = bool(os.environ.get("THROWCAL_LONG"))
KERNELS = (12, 13) if LONG else (13,)
FRAMES = 600 if LONG else 150
CYCLES = 200 if LONG else 5
IDENTITIES = (("Acme", "Eye 300", "SN0042"), ("Other", "Cam X", ""))
KNOWN = (("Acme", "Eye 300", "SN0042"), ("Other", "Cam X", "0815"))
LINK = "/dev/v4l/by-path/platform-vhci_hcd.0-usb-0:{}:1.0-video-index0"  # the kernel counts ports from 1
FIRST, SECOND = LINK.format(1), LINK.format(2)

PRELUDE = """
set -e
modprobe -a vhci-hcd uvcvideo
mkfifo /run/commands
exec 9<> /run/commands
./usb_camera IDENTITIES <&9 > out/usb.log 2>&1 &
usb=$!
await() { until eval "$1"; do kill -0 $usb; sleep 0.05; done; }
here() { await "[ -e FIRST ] && [ -e SECOND ]"; udevadm settle; }
gone() { await "! [ -e FIRST ] && ! [ -e SECOND ]"; }
grab() { # OUT ARGUMENT...
  local out=out/$1; shift
  LD_PRELOAD=./liblog_buffers.so BUFFER_LOG=$out.driver exec ./grab "$@" times=$out.frames > $out.log 2>&1
}
control() { v4l2-ctl --device FIRST "$@"; }
swap() { echo unplug 0 >&9; echo unplug 1 >&9; gone; echo plug 0 $1 >&9; echo plug 1 $((1 - $1)) >&9; here; }
"""

SCRIPT = f"""
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

control --set-ctrl=auto_exposure=3,focus_automatic_continuous=1,white_balance_automatic=1 # ours has switched them off
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
uptime_s() {{ cut -d' ' -f1 /proc/uptime; }}
back() {{ grep -c 'is back' out/plugged.log; }}
await "[ -s out/plugged.driver ]"
sleep 1
for n in $(seq {CYCLES}); do
  up=$(uptime_s); echo unplug 0 >&9
  await "[ \\$(grep -c 'was unplugged' out/plugged.log) = $n ]"
  out=$(uptime_s); echo plug 0 >&9
  await "[ \\$(back) = $n ]"
  echo $up $out $(uptime_s) >> out/times
  [ $n != 3 ] || echo $(ls /proc/$grab/fd | wc -l) $(rss) > out/early
done
sleep 1
echo $(ls /proc/$grab/fd | wc -l) $(rss) > out/late
kill $grab
wait $grab
control --list-ctrls > out/fresh

swap 1
./throwcal cameras --json > out/swapped
exec 9>&-
"""

TRUST = f"""
here
grab held 320x240 200 fps=30 serial=SN0042 exposure=0.004 gain=64 {FIRST} & # by a wire that comes off, a stranger's hand, and swapped cables
grab=$!
await "[ \\$(wc -l < out/held.driver) -gt 35 ]" # the automatics may settle first
control --list-ctrls > out/while_held
control --set-ctrl=gain=20
await "control --get-ctrl=gain | grep -q 64"
echo unplug 0 >&9
await "grep -q 'was unplugged' out/held.log"
echo plug 0 >&9
await "grep -q 'is back' out/held.log"
control --list-ctrls > out/replugged
swap 1
await "grep -q 'here is' out/held.log"
swap 0
await "[ \\$(grep -c 'is back' out/held.log) = 2 ]"
kill $grab
wait $grab

for wish in exposure=9 gain=1000 serial=0815; do ./grab 320x240 1 $wish {FIRST} > out/$wish 2>&1 || true; done
echo unplug 1 >&9
await "! [ -e {SECOND} ]"
grab missing 320x240 200 fps=30 missing=1 frames=20 {FIRST} {SECOND} &
await "grep -q 'is not plugged in' out/missing.log"
echo plug 1 >&9
wait $!

state=/run/throwcal # SQLite wants a file system that maps memory
box() {{ # RIG: a throwcald
  rm -f port
  ./throwcald --config $1 --listen 127.0.0.1:0 --http-listen 127.0.0.1:0 --port-file port --state-dir $state 2>> out/throwcald.log &
  box=$!
  await "[ -s port ]"
  host="--host 127.0.0.1:$(cat port)"
}}
ended() {{ kill $box; wait $box; }}
box rig.toml
await "./throwcal status --json $host > out/right; ! grep -q '\"view\": \"learning\"' out/right"
export THROWCAL_TOKEN=$(cat $state/token)
./throwcal capture start $host > out/session
./throwcal capture stop $host >> out/session # nobody throws
ended
python3 put_calibration.py $state/sessions/000001.throwcal calibration.json
box rig.toml
./throwcal fetch $host > out/fetched 2>&1 || true
ended
swap 1
for rig in rig unnamed; do
  box $rig.toml
  await "./throwcal status --json $host > out/swapped.$rig; grep -q 'cables are swapped' out/swapped.$rig"
  ./throwcal fetch $host > out/refused.$rig 2>&1 || true
  ended
done
exec 9>&-
"""

PUT_CALIBRATION = """
import hashlib, sqlite3, sys
document = open(sys.argv[2]).read()
with sqlite3.connect(sys.argv[1]) as database:
    row = ("", "accepted", 5, 0, hashlib.sha256(document.encode()).hexdigest(), document)
    database.execute("INSERT INTO calibration(created_utc, verdict, throws, flights, sha256, document) VALUES(?, ?, ?, ?, ?, ?)", row)
"""


def check_listing(result: vm.Result) -> None:
    cameras = json.loads(result.text("cameras"))
    assert [c["model"] for c in cameras] == [model for _, model, _ in IDENTITIES], cameras
    for port, camera in enumerate(cameras, 1):
        assert camera["driver"] == "uvcvideo" and camera["by_path"] == LINK.format(port) and camera["problem"] is None, camera
        assert camera["bus"] == f"usb-vhci_hcd.0-{port}", camera
        (yuyv,) = camera["formats"]
        rates = {size["size"]: [round(rate) for rate in size["frames_per_s"]] for size in yuyv["sizes"]}
        assert yuyv["pixel_format"] == "YUYV" and rates == {"320x240": [30, 15], "640x480": [30, 15]}, camera
    swapped = {c["model"]: c["by_path"] for c in json.loads(result.text("swapped"))}
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
            print(
                f"  {name}: {len(stamps)} frames, {min(steps):.2f} to {max(steps):.2f} ms apart; sigma {counted['time_sigma_s'] * 1e6:.0f} us",
                flush=True,
            )
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
    for name, exposure, gain in (("kept", 50, 64), ("fresh", 50, 64)):  # plugged anew, it is set as it was
        said = [line.split() for line in result.text(name).splitlines()]
        values = {words[0]: words for words in said if words}
        assert f"value={gain}" in values["gain"], values
        assert f"value={exposure}" in values["exposure_time_absolute"], values


def check_unplugging(result: vm.Result) -> None:
    run = Run(result, "plugged")
    early, late = ([int(word) for word in result.text(name).split()] for name in ("early", "late"))
    counted = run.counters[FIRST]
    print(f"  {CYCLES} times unplugged; {counted}; open files {early[0]} -> {late[0]}, resident kB {early[1]} -> {late[1]}", flush=True)
    assert counted["interruptions"] == CYCLES and counted["error"] == "" and counted["lost"] == counted["damaged"] == counted["dropped"] == 0, counted
    # All that came, though the driver no longer takes the last buffers back.
    stamps = {stamp for frames in run.frames.values() for _, stamp in frames}
    given_up = sum(stamp not in stamps for answers in run.driver.values() for _, _, stamp, _ in answers)
    assert given_up <= 2, given_up  # when grab ends
    times = [[float(word) for word in line.split()] for line in result.text("times").splitlines()]
    noticed, back = sorted(b - a for a, b, _ in times), sorted(c - b for _, b, c in times)
    print(
        f"  noticed after {statistics.median(noticed):.2f} s, {noticed[-1]:.2f} s at most; back after {statistics.median(back):.2f} s, {back[-1]:.2f} s at most",
        flush=True,
    )
    assert run.said.count(f"{FIRST}: {FIRST}: was unplugged") == run.said.count(f"{FIRST}: is back") == CYCLES, run.said
    assert late[0] == early[0] and late[1] < early[1] + 2000, (early, late)
    check_undisturbed(run, SECOND)
    steps = [(b[1] - a[1]) / 1e6 for a, b in zip(run.frames[SECOND], run.frames[SECOND][1:])]
    print(f"  the other: {len(steps) + 1} frames, {min(steps):.2f} to {max(steps):.2f} ms apart", flush=True)


def value(text: str, control: str) -> int:
    return int(next(line for line in text.splitlines() if line.split()[:1] == [control]).split("value=")[1].split()[0])


def check_trust(result: vm.Result) -> None:
    held = Run(result, "held")
    (counted,) = held.counters.values()
    print(f"  held: {counted}; said {held.said}", flush=True)
    for name in ("while_held", "replugged"):
        now = {what: value(result.text(name), what) for what in ("auto_exposure", "white_balance_automatic", "focus_automatic_continuous")}
        now |= {what: value(result.text(name), what) for what in ("exposure_time_absolute", "gain")}
        assert list(now.values()) == [1, 0, 0, 40, 64], (name, now)
    assert counted["exposure_s"] == 0.004 and counted["gain"] == 64 and counted["automatic"] == [] and counted["set_back"] >= 1, counted
    assert counted["is"] == '"Eye 300", serial SN0042' and counted["mode"] == "320x240 YUYV at 30/s", counted
    assert counted["interruptions"] == 2 and held.said[0] == f"{FIRST}: {FIRST}: was unplugged" and held.said[-1] == f"{FIRST}: is back", held.said
    assert f'{FIRST}: {FIRST}: here is "Cam X", serial 0815; expected "Eye 300", serial SN0042' in held.said, held.said
    for name, message in (
        ("exposure=9", "exposure_s = 9: the camera goes from 0.0001 to 0.5"),
        ("gain=1000", "gain = 1000: the camera goes from 1 to 128"),
        ("serial=0815", 'here is "Eye 300", serial SN0042; expected a camera, serial 0815'),
    ):
        assert result.text(name).rstrip() == f"grab: camera {FIRST}: {FIRST}: {message}", result.text(name)
    missing = Run(result, "missing")
    assert all(c["frames"] >= 20 and c["error"] == "" for c in missing.counters.values()), missing.counters
    assert missing.said[0] == f"{SECOND}: {SECOND}: is not plugged in" and missing.said[-1] == f"{SECOND}: is back", missing.said


def check_box(result: vm.Result) -> None:
    cameras = json.loads(result.text("right"))["cameras"]
    assert [c["settings"]["exposure_s"] for c in cameras] == [0.004, 0.004] and all(c["error"] is None for c in cameras), cameras
    assert "verdict: " in result.text("fetched"), result.text("fetched")
    named, unnamed = (json.loads(result.text(f"swapped.{rig}")) for rig in ("rig", "unnamed"))
    print("  " + "\n  ".join([named["cameras"][0]["error"], unnamed["calibration_problem"], result.text("refused.rig").strip()]), flush=True)
    assert named["cameras"][0]["error"].endswith('which the rig file calls "east": the cables are swapped; expected a camera, serial SN0042'), named
    assert all(c["error"] is None and c["frames"] > 0 for c in unnamed["cameras"]), unnamed
    for status in (named, unnamed):
        assert status["calibration_problem"].count("cables are swapped") == 2, status
    for rig in ("rig", "unnamed"):
        assert 'the last calibration is not of these cameras, calibrate again: camera "north" was' in result.text(f"refused.{rig}"), result.text(
            f"refused.{rig}"
        )


def box_files(build: pathlib.Path) -> dict[str, pathlib.Path | str]:
    """A rig of the two cameras, one without their serial numbers, and a calibration made with them."""
    with tempfile.TemporaryDirectory() as name:
        site = pathlib.Path(name)
        throwcal = [build / "throwcal"]
        subprocess.run(
            [*throwcal, "simulate", "--output", site, "--cameras", "2", "--width", "320", "--height", "240", "--focal", "240"],
            check=True,
            stdout=subprocess.DEVNULL,
        )
        files = ["--rig", site / "rig.toml", "--sightings", site / "sightings.csv", "--output", site / "calibration.json"]
        subprocess.run([*throwcal, "calibrate", *files], stdout=subprocess.DEVNULL)  # whatever its verdict
        made, rig = ((site / file).read_text().replace("cam1", "north").replace("cam2", "east") for file in ("calibration.json", "rig.toml"))
    document = json.loads(made)
    for camera, link, port, (_, model, serial) in zip(document["cameras"], (FIRST, SECOND), (1, 2), KNOWN):
        rig = rig.replace('source = "simulated"', f'source = "v4l2:{link}"\nframes_per_s = 30\nexposure_s = 0.004\nserial = "{serial}"', 1)
        camera["device"] = {"port": f"usb-vhci_hcd.0-{port}", "model": model, "serial": serial, "mode": "320x240 YUYV at 30/s"}
    unnamed = "".join(line for line in rig.splitlines(keepends=True) if not line.startswith("serial"))
    return {"rig.toml": rig, "unnamed.toml": unnamed, "calibration.json": json.dumps(document), "put_calibration.py": PUT_CALIBRATION}


def prelude(identities) -> str:
    words = " ".join(f"'{','.join(identity)}'" for identity in identities)
    return PRELUDE.replace("IDENTITIES", words).replace("FIRST", FIRST).replace("SECOND", SECOND)


def main() -> None:
    build = pathlib.Path(sys.argv[sys.argv.index("--build") + 1])
    files = {name: build / "tests" / name for name in ("grab", "liblog_buffers.so", "usb_camera")} | {"throwcal": build / "throwcal"}
    files |= {"throwcald": build / "throwcald"} | box_files(build)
    cases = ((IDENTITIES, SCRIPT, (check_listing, check_frames, check_controls, check_unplugging)), (KNOWN, TRUST, (check_trust, check_box)))
    for kernel in KERNELS:
        for identities, script, checks in cases:
            result = vm.run_in_guest(kernel, files, prelude(identities) + script, 1500, ("--icount",))
            print(f"kernel {kernel}: {result.total_s:.0f} s", flush=True)
            said = {name: result.text(name)[-2000:] for name in result.files if name.endswith(".log")}
            assert result.rc == 0, f"exit status {result.rc}\n{result.output}\n{said}"
            for check in checks:
                check(result)


if __name__ == "__main__":
    main()
