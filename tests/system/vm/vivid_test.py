#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Our V4L2 cameras on the kernel's virtual ones (vivid): what is lost, damaged or gone is counted and named exactly as the driver
has it, and every frame keeps the driver's stamp. THROWCAL_LONG=1: 10,000 frames at each loss rate and both
kernels, else a twentieth and one."""

import collections
import json
import os
import pathlib
import subprocess
import sys
import tempfile

import vm

LONG = bool(os.environ.get("THROWCAL_LONG"))
FRAMES = 2500 if LONG else 125  # of each of four cameras
KERNELS = (12, 13) if LONG else (13,)
CYCLES = 200 if LONG else 12  # of unplugging
LOSSES = (0, 10, 30)  # per cent

PRELUDE = """
set -e
modprobe vivid n_devs=4 node_types=0x1,0x1,0x1,0x1
udevadm settle
cameras="/dev/video0 /dev/video1 /dev/video2 /dev/video3"
control() { v4l2-ctl --device $1 --set-ctrl $2; }
grab() { # OUT ARGUMENT...: what it printed, the frames it gave, what the driver answered
  local out=out/$1; shift
  LD_PRELOAD=./liblog_buffers.so BUFFER_LOG=$out.driver ./grab "$@" times=$out.frames > $out.log 2>&1
}
streaming() { until [ -s out/$1.driver ]; do sleep 0.1; done; sleep 1; } # OUT: frames come, since a second
"""


def losses() -> str:
    """Frames that the driver drops, as many per cent of them; then its counter and its stamps wrap."""
    script = ""
    for loss in LOSSES:
        script += f"for c in $cameras; do control $c percentage_of_dropped_buffers={loss}; done\n"
        script += f"grab lost{loss} 320x180 400 fps=30 frames={FRAMES} $cameras\n"
    script += "for c in $cameras; do control $c percentage_of_dropped_buffers=10; control $c wrap_sequence_number=1; done\n"
    script += "grab wrapped 320x180 60 fps=30 frames=200 $cameras\n"
    script += "for c in $cameras; do control $c wrap_sequence_number=0; control $c timestamp_source=1; done\n"
    script += "grab start_of_exposure 320x180 60 fps=30 frames=40 $cameras\n"
    for wrap in (1, 2):
        script += f"control /dev/video0 wrap_timestamp={wrap}\n"
        script += f"grab stamps{wrap} 320x180 60 fps=30 frames=40 /dev/video0\n"
    return script


FAULTS = """
( streaming damaged; for i in 1 2 3; do control /dev/video0 inject_v4l2_buf_flag_error=1; sleep 0.7; done ) &
grab damaged 320x180 12 fps=30 /dev/video0 /dev/video1
wait
( streaming fatal; control /dev/video0 inject_fatal_streaming_error=1 ) &
grab fatal 320x180 9 fps=30 /dev/video0 /dev/video1
wait
control /dev/video0 inject_vidioc_streamon_error=1
grab streamon 320x180 6 fps=30 /dev/video0 /dev/video1
( streaming unplugged; control /dev/video0 disconnect=1; sleep 3; echo vivid.0 > /sys/bus/platform/drivers/vivid/unbind
  echo vivid.0 > /sys/bus/platform/drivers/vivid/bind ) &
grab unplugged 320x180 16 fps=30 /dev/video0 /dev/video1
wait
for size in 322x180 5000x180; do ./grab $size 1 /dev/video0 > out/size.$size 2>&1 || true; done
./grab 320x180 1 format=H264 /dev/video0 > out/format 2>&1 || true
./grab 320x180 1 input=Composite /dev/video0 > out/input 2>&1 || true
./grab 320x180 1 /dev/video9 > out/none 2>&1 || true
./grab 320x180 1 /dev/null > out/null 2>&1 || true
( streaming stepped; date --set='+1 hour'; sleep 1; date --set='-3 hours' ) > /dev/null &
grab stepped 320x180 6 fps=30 /dev/video1
wait
mkdir /run/small
mount -t tmpfs -o size=10m none /run/small
v4l2-ctl --device /dev/video0 --set-fmt-video=width=320,height=180 --set-parm=25
./throwcal record --source v4l2:/dev/video0 --output /run/small --seconds 200 > out/full 2>&1 || echo $? > out/full.status
cp /run/small/cam1.* out/
v4l2-ctl --device /dev/video1 --set-fmt-video=width=640,height=360
./throwcal snapshot --source v4l2:/dev/video1 --output out > out/snapshot 2>&1
./throwcal cameras --json > out/cameras
./throwcal cameras > out/cameras.text
echo vivid.0 > /sys/bus/platform/drivers/vivid/unbind
./throwcal cameras > out/no_cameras
"""

ENDURANCE = f"""
rss() {{ grep VmRSS /proc/$1/status | tr -dc 0-9; }}
LD_PRELOAD=./liblog_buffers.so BUFFER_LOG=out/plugged.driver ./grab 320x180 {12 + 2.1 * CYCLES} fps=30 /dev/video0 /dev/video1 > out/plugged.log 2>&1 &
grab=$!
streaming plugged
for n in $(seq {CYCLES}); do
  [ $n != 4 ] || echo $(ls /proc/$grab/fd | wc -l) $(rss $grab) > out/early
  echo vivid.0 > /sys/bus/platform/drivers/vivid/unbind; sleep 0.5
  echo vivid.0 > /sys/bus/platform/drivers/vivid/bind; sleep 1.5
done
echo $(ls /proc/$grab/fd | wc -l) $(rss $grab) > out/late
wait $grab
./grab 320x180 60 fps=30 rounds=1,2,3,5,8,13,21,34,55,89,1,2,3,5,8,13,21,34,55,89 $cameras > out/matrix.log 2>&1
"""

FIELDS = """
v4l2-ctl --device /dev/video0 --set-input 1 --set-standard pal
v4l2-ctl --device /dev/video0 --list-inputs > out/inputs
grab pal 720x576 30 input=1 standard=PAL frames=60 /dev/video0
grab ntsc 720x480 30 input=1 standard=NTSC frames=60 /dev/video0
v4l2-ctl --device /dev/video0 --set-input 0
formats() { # PLANES
  for format in GREY NV12 YUYV UYVY BA81 GRBG; do
    for colour in no yes; do
      ./grab 320x180 30 $([ $colour = no ] || echo colour=1) format=$format frames=5 /dev/video0 > out/$1.$format.$colour 2>&1
    done
  done
}
formats single
modprobe -r vivid
modprobe vivid n_devs=1 node_types=0x1 multiplanar=2
udevadm settle
v4l2-ctl --device /dev/video0 --info > out/planes
formats multi
"""


class Run:
    """One call of grab: its counters by camera, its frames, and what the driver answered."""

    def __init__(self, result: vm.Result, name: str) -> None:
        lines = result.text(f"{name}.log").splitlines()
        self.counters = {c["camera"]: c for c in map(json.loads, (line for line in lines if line.startswith("{")))}
        self.said = [line for line in lines if not line.startswith("{")]
        self.frames = collections.defaultdict(list)  # by camera: (sequence, middle less half the exposure: the driver's stamp, ns)
        for line in result.text(f"{name}.frames").splitlines():
            camera, sequence, stamp, _, exposure_ns = line.split()
            self.frames[camera].append((int(sequence), int(stamp) - int(exposure_ns) // 2))
        self.driver = collections.defaultdict(list)  # by file descriptor: (sequence, flags, stamp ns, field)
        for line in result.text(f"{name}.driver").splitlines():
            fd, sequence, flags, stamp, field, _ = line.split()
            self.driver[fd].append((int(sequence), int(flags, 16), int(stamp), int(field)))

    def driver_of(self, camera: str) -> list[tuple[int, int, int, int]]:
        """The answers that this camera got: those that hold its frames' stamps."""
        stamps = {stamp for _, stamp in self.frames[camera]}
        return max(self.driver.values(), key=lambda answers: len(stamps & {answer[2] for answer in answers}))


def gaps(answers) -> int:
    return sum((after[0] - before[0]) % 2**32 - 1 for before, after in zip(answers, answers[1:]))


def check_losses(result: vm.Result) -> None:
    for name in [f"lost{loss}" for loss in LOSSES] + ["wrapped"]:
        run, total, lost = Run(result, name), 0, 0
        assert len(run.counters) == 4, result.output
        for camera, counted in run.counters.items():
            answers = run.driver_of(camera)
            # grab ends in the midst of frames: the driver may have answered a few times more.
            stamps = [stamp for _, stamp in run.frames[camera]]
            answers = answers[: 1 + max(i for i, answer in enumerate(answers) if answer[2] == stamps[-1])]
            assert counted["dropped"] == counted["interruptions"] == 0 and counted["error"] == "", counted
            damaged = sum(bool(flags & 0x40) for _, flags, _, _ in answers)
            assert counted["damaged"] == damaged, (name, counted, damaged)
            assert [a[2] for a in answers if not a[1] & 0x40] == stamps, f"{name}: {camera}: not the driver's stamps"
            assert gaps(answers) <= counted["lost"] <= gaps(run.driver_of(camera)), (name, counted, gaps(answers))
            sequences = [sequence for sequence, _ in run.frames[camera]]
            assert sequences[-1] - sequences[0] + 1 - len(sequences) == gaps(answers) + damaged - bool(answers[0][1] & 0x40), (name, camera)
            assert counted["timestamps"] == "end of frame", counted
            total, lost = total + len(sequences), lost + gaps(answers)
        print(f"  {name}: {total} frames of 4 cameras; the driver lost {lost}, so it was counted", flush=True)
        if name != "lost0":
            assert lost > 0.03 * total, name
    wrapped = Run(result, "wrapped")
    assert any(a[0] > 2**31 for a in wrapped.driver_of("/dev/video0")) and any(a[0] < 2**31 for a in wrapped.driver_of("/dev/video0"))
    exposure = Run(result, "start_of_exposure")
    assert all(c["timestamps"] == "start of exposure" for c in exposure.counters.values()), exposure.counters
    for wrap in (1, 2):
        stamps = Run(result, f"stamps{wrap}")
        (counted,) = stamps.counters.values()
        assert counted["timestamps"] == "when it was dequeued" and counted["frames"] >= 40, counted
        times = [time for _, time in stamps.frames["/dev/video0"]]
        assert all(0 < b - a < 10**9 for a, b in zip(times, times[1:])), "time goes on"


def check_faults(result: vm.Result) -> None:
    calm = {name: Run(result, name) for name in ("damaged", "fatal", "streamon", "unplugged")}
    for name, run in calm.items():
        first, second = run.counters["/dev/video0"], run.counters["/dev/video1"]
        print(f"  {name}: {first}; said {run.said}", flush=True)
        assert first["error"] == "", (name, first)
        if name != "unplugged":  # which unbinds the driver of both
            assert second["interruptions"] == second["damaged"] == 0, (name, second)
    damaged = calm["damaged"]
    flagged = sum(bool(flags & 0x40) for _, flags, _, _ in damaged.driver_of("/dev/video0"))
    assert damaged.counters["/dev/video0"]["damaged"] == flagged > 0, (flagged, damaged.counters)
    for name, cause in (("fatal", "VIDIOC_DQBUF"), ("streamon", "VIDIOC_STREAMON"), ("unplugged", "was unplugged")):
        run = calm[name]
        assert run.counters["/dev/video0"]["interruptions"] >= 1, (name, run.counters)
        assert any(line.startswith("/dev/video0: ") and cause in line for line in run.said), (name, run.said)
        assert run.said[-1].endswith("is back"), (name, run.said)
    for name, message in (
        ("size.322x180", "gives pictures of 320x180; the rig says 322x180"),
        ("size.5000x180", "the rig says 5000x180"),
        ("format", "expected H264"),
        ("input", 'has no input "Composite"; expected one of 0 "'),
        ("none", "/dev/video9: No such file or directory"),
        ("null", "/dev/null: is no V4L2 device"),
    ):
        text = result.text(name)
        assert text.startswith("grab: camera ") and message in text and text.count("\n") == 1, (name, text)


def check_clock_and_disk(result: vm.Result, build: pathlib.Path) -> None:
    """A wall clock that is set changes nothing; a disk that fills up ends a film that can be read."""
    stepped = Run(result, "stepped")
    (counted,), frames = stepped.counters.values(), stepped.frames["/dev/video1"]
    steps = [(b[1] - a[1]) / 1e6 for a, b in zip(frames, frames[1:])]
    print(f"  clock set twice: {len(frames)} frames, {min(steps):.1f} to {max(steps):.1f} ms apart", flush=True)
    assert counted["lost"] == counted["interruptions"] == 0 and len(frames) > 60 and 0 < min(steps) and max(steps) < 1000, (counted, steps)
    said, times = result.text("full"), result.text("cam1.timestamps.txt").splitlines()[1:]
    assert result.text("full.status") == "1\n" and 'camera "cam1": /run/small/cam1.mkv: the disk is full' in said, said
    with tempfile.TemporaryDirectory() as folder:
        film = pathlib.Path(folder) / "cam1.mkv"
        film.write_bytes(result.files["cam1.mkv"])
        seen = subprocess.run([build / "throwcal", "detect", film], capture_output=True, text=True)
    frames = next(int(line.split()[1]) for line in seen.stdout.splitlines() if line.startswith("cam1"))
    print(f"  disk full after {frames} frames: {len(times)} times", flush=True)
    assert frames == len(times) > 16, (frames, len(times), said)


def check_listing(result: vm.Result) -> None:
    picture = result.files["cam1.png"]
    assert picture.startswith(b"\x89PNG") and int.from_bytes(picture[16:20], "big") == 640 and result.text("snapshot") == "out/cam1.png\n", picture[
        :30
    ]
    cameras = json.loads(result.text("cameras"))
    assert [c["device"] for c in cameras] == [f"/dev/video{i}" for i in range(4)], cameras
    for i, camera in enumerate(cameras):
        assert camera["driver"] == "vivid" and camera["bus"] == f"platform:vivid-{i:03}" and camera["problem"] is None, camera
        usable = {f["pixel_format"]: f for f in camera["formats"] if f["usable"]}
        assert {"GREY", "NV12", "YUYV", "UYVY", "BA81"} <= set(usable), usable.keys()
        rates = {size["size"]: size["frames_per_s"] for size in usable["GREY"]["sizes"]}
        assert 60 in rates["320x180"] and max(rates["640x360"]) >= 25, rates
        assert len(camera["inputs"]) == 4, camera["inputs"]
    text = result.text("cameras.text")
    assert text.count('source = "v4l2:/dev/') == 4 and "GREY 320x180 at " in text, text
    assert result.text("no_cameras").startswith("no V4L2 camera is here"), result.text("no_cameras")


def check_endurance(result: vm.Result) -> None:
    early, late = ([int(word) for word in result.text(name).split()] for name in ("early", "late"))
    ends = [json.loads(line) for line in result.text("plugged.log").splitlines() if line.startswith("{")]
    print(
        f"  {CYCLES} times unplugged, {ends[0]['interruptions']} times back; open files {early[0]} -> {late[0]}, resident kB {early[1]} -> {late[1]}",
        flush=True,
    )
    assert all(c["interruptions"] == CYCLES and c["error"] == "" for c in ends) and len(ends) == 2, result.text("plugged.log")
    assert late[0] == early[0] and late[1] < early[1] + 2000, (early, late)
    rounds = [json.loads(line) for line in result.text("matrix.log").splitlines() if line.startswith("{")]
    assert len(rounds) == 20 * 4 and all(r["error"] == "" and r["dropped"] == 0 for r in rounds), result.text("matrix.log")
    assert all(r["frames"] >= n for r, n in zip(rounds, [n for n in (1, 2, 3, 5, 8, 13, 21, 34, 55, 89) * 2 for _ in range(4)])), rounds
    files = [max(r["files"] for r in rounds[4 * i : 4 * i + 4]) for i in range(20)]
    print(f"  started and stopped 20 times: open files {files[0]} -> {files[-1]}", flush=True)
    assert files[-1] <= files[0], files


def check_fields(result: vm.Result) -> None:
    for name, interval_ms in (("pal", 20), ("ntsc", 1001 / 60)):
        run = Run(result, name)
        (counted,) = run.counters.values()
        frames = run.frames["/dev/video0"]
        steps = [(b[1] - a[1]) / 1e6 / (b[0] - a[0]) for a, b in zip(frames, frames[1:])]
        within = sorted(step for (a, _), step in zip(frames, steps) if a % 2 == 0)
        print(f"  {name}: {len(frames)} half-frames; a frame's two are {within[0]:.4f} to {within[-1]:.4f} ms apart; {counted}", flush=True)
        assert counted["time_sigma_s"] < 0.005, counted
        assert len(frames) >= 60 and all(abs(step - interval_ms) < 0.01 for step in within), (name, steps)
        assert min(steps) > 0 and abs(sum(steps) / len(steps) - interval_ms) < 0.1 * interval_ms, (name, steps)
    assert "Video Capture Multiplanar" in result.text("planes"), result.text("planes")
    levels = {}
    for kind in ("single", "multi"):
        for form in ("GREY", "NV12", "YUYV", "UYVY", "BA81", "GRBG"):
            for colour in ("no", "yes"):
                (counted,) = map(json.loads, result.text(f"{kind}.{form}.{colour}").splitlines())
                assert counted["frames"] >= 5 and counted["error"] == "" and counted["mode"].startswith(f"320x180 {form}"), (kind, counted)
                levels[kind, form, colour] = counted["levels"]
    print(f"  pixel formats, darkest and brightest: {levels}", flush=True)
    assert all(brightest - darkest > 100 for darkest, brightest in levels.values()), levels


def main() -> None:
    build = pathlib.Path(sys.argv[sys.argv.index("--build") + 1]) / "tests"
    files = {"grab": build / "grab", "liblog_buffers.so": build / "liblog_buffers.so", "throwcal": build.parent / "throwcal"}
    for kernel in KERNELS:
        for script, check in ((losses(), check_losses), (FAULTS, check_faults), (ENDURANCE, check_endurance), (FIELDS, check_fields)):
            result = vm.run_in_guest(kernel, files, PRELUDE + script, 900, ("--icount",))
            print(f"kernel {kernel}, {check.__name__.removeprefix('check_')}: {result.total_s:.0f} s", flush=True)
            said = {name: result.text(name)[-2000:] for name in result.files if name.endswith(".log")}
            assert result.rc == 0, f"exit status {result.rc}\n{result.output}\n{said}"
            check(result)
            if check is check_faults:
                check_listing(result)
                check_clock_and_disk(result, build.parent)


if __name__ == "__main__":
    main()
