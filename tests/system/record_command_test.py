#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""`throwcal record` and `throwcal snapshot`: films that `detect` and `calibrate` read, saved also when Ctrl-C ends them; pictures; and
one clear line where something is wrong."""
import pathlib
import signal
import subprocess
import sys
import tempfile
import time

import box


def throwcal(build: pathlib.Path, *arguments) -> subprocess.CompletedProcess:
    return subprocess.run([build / "throwcal", *map(str, arguments)], capture_output=True, text=True, timeout=60)


def times_of(film: pathlib.Path) -> list[float]:
    lines = film.with_suffix(".timestamps.txt").read_text().splitlines()
    assert lines[0] == "# timestamp format v2", lines[0]
    return [float(line) for line in lines[1:]]


def frames_of(build: pathlib.Path, film: pathlib.Path) -> int:
    done = throwcal(build, "detect", film)
    assert done.returncode == 0, done
    return next(int(line.split()[1]) for line in done.stdout.splitlines() if line.startswith(film.stem))


def films_have_a_time_for_each_frame(build: pathlib.Path, folder: pathlib.Path) -> None:
    done = throwcal(build, "record", "--rig", folder / "rig.toml", "--output", folder / "films", "--seconds", "2")
    assert done.returncode == 0 and done.stderr == "", done
    for name in ("cam1", "cam2"):
        film = folder / "films" / f"{name}.mkv"
        times = times_of(film)
        reported = next(line.split() for line in done.stdout.splitlines() if line.startswith(name))
        lost = sum(map(int, reported[2:]))
        assert len(times) == int(reported[1]) == frames_of(build, film), (reported, len(times))
        steps = [b - a for a, b in zip(times, times[1:])]
        assert 15 <= len(times) <= 80 and min(steps) > 0, (len(times), steps)
        intervals = round((times[-1] - times[0]) * 30 / 1000)
        assert abs(times[-1] - times[0] - 1000 / 30 * intervals) < 0.01, times
        assert len(times) - 1 <= intervals <= len(times) - 1 + lost, (reported, intervals)


def ctrl_c_saves_what_was_filmed(build: pathlib.Path, folder: pathlib.Path) -> None:
    command = [build / "throwcal", "record", "--rig", folder / "rig.toml", "--output", folder / "short", "--camera", "cam2", "--seconds", "3600"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as filming:
        film = folder / "short" / "cam2.mkv"
        until = time.monotonic() + 30
        while not (film.exists() and film.stat().st_size > 100_000):
            assert filming.poll() is None and time.monotonic() < until, filming.communicate()
            time.sleep(0.02)
        filming.send_signal(signal.SIGINT)
        out, err = filming.communicate(timeout=30)
    assert filming.returncode == 0 and err == "", (filming.returncode, out, err)
    assert len(times_of(film)) == frames_of(build, film) > 0
    assert not (folder / "short" / "cam1.mkv").exists()


def enter_after_the_throw_still_has_it(build: pathlib.Path, folder: pathlib.Path) -> None:
    command = [build / "throwcal", "record", "--rig", folder / "rig.toml", "--output", folder / "before", "--before", "2", "--seconds", "0.3"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as filming:
        assert "press Enter" in filming.stderr.readline()
        time.sleep(4)  # what is to be filmed happens
        pressed_ms = 1000 * time.clock_gettime(time.CLOCK_MONOTONIC)
        out, err = filming.communicate("\n", timeout=60)
    assert filming.returncode == 0 and err == "", (filming.returncode, out, err)
    for name in ("cam1", "cam2"):
        film = folder / "before" / f"{name}.mkv"
        times = times_of(film)
        assert len(times) == frames_of(build, film)
        steps = [b - a for a, b in zip(times, times[1:])]
        reported = next(line.split() for line in out.splitlines() if line.startswith(name))
        assert min(steps) > 1, "no frame twice"
        assert times[0] >= pressed_ms - 2000 and times[0] < pressed_ms - 1500, (times[0], pressed_ms)
        assert times[-1] > pressed_ms, (times[-1], pressed_ms)
        gaps = sum(round(step * 30 / 1000) - 1 for step in steps)
        assert gaps <= sum(map(int, reported[2:])), (gaps, reported, "nothing is lost where past and present meet")


def ctrl_c_while_standing_by_ends_it(build: pathlib.Path, folder: pathlib.Path) -> None:
    command = [build / "throwcal", "record", "--rig", folder / "rig.toml", "--output", folder / "none", "--before", "2"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as filming:
        assert "press Enter" in filming.stderr.readline()
        filming.send_signal(signal.SIGINT)
        out, err = filming.communicate(timeout=30)
    assert filming.returncode == 1 and out == err == "", (filming.returncode, out, err)


def a_snapshot_is_a_picture(build: pathlib.Path, folder: pathlib.Path) -> None:
    done = throwcal(build, "snapshot", "--rig", folder / "rig.toml", "--output", folder / "pictures")
    assert done.returncode == 0 and done.stdout.count(".png\n") == 2, done
    for name in ("cam1", "cam2"):
        picture = (folder / "pictures" / f"{name}.png").read_bytes()
        assert picture.startswith(b"\x89PNG") and int.from_bytes(picture[16:20], "big") == 160, picture[:30]


def what_is_wrong_is_said(build: pathlib.Path, folder: pathlib.Path) -> None:
    rig = (folder / "rig.toml").read_text()
    for name, source in (("gone", "v4l2:/dev/video99"), ("null", "v4l2:/dev/null"), ("file", "file:no.mkv")):
        (folder / f"{name}.toml").write_text(rig.replace('source = "simulated"', f'source = "{source}"', 1))
    (folder / "taken").write_text("")
    (folder / "small.toml").write_text(rig.replace("[daemon]", "[daemon]\nframe_memory_mb = 3"))
    films = throwcal(build, "record", "--rig", folder / "small.toml", "--output", folder / "x", "--before", "10")
    assert films.returncode == 2 and films.stderr == (
        "throwcal: frames need 14 MB of memory (cam1 364 of 160x120 in 7 MB, cam2 364 of 160x120 in 7 MB); expected 3 MB at most, by [daemon] "
        "frame_memory_mb or half of this machine's: film for less long, more slowly or smaller\n"
    ), films
    for arguments, message in [(["--rig", folder / "gone.toml", "--output", folder / "x"], "camera cam1: /dev/video99: No such file or directory"),
                               (["--rig", folder / "null.toml", "--output", folder / "x"], "camera cam1: /dev/null: is no V4L2 device"),
                               (["--rig", folder / "file.toml", "--output", folder / "x"], "no.mkv: no such video file"),
                               (["--rig", folder / "rig.toml", "--output", folder / "x", "--camera", "cam9"], '"cam9" is not in the rig file'),
                               (["--rig", folder / "rig.toml", "--output", folder / "taken"], "taken: can't be made"),
                               (["--output", folder / "x"], "expected --rig FILE, or --source v4l2:DEVICE"),
                               (["--rig", folder / "rig.toml", "--source", "v4l2:/dev/video0", "--output", folder / "x"], "expected --rig FILE, or --source"),
                               (["--source", "/dev/video0", "--output", folder / "x"], '--source: "/dev/video0"; expected "v4l2:DEVICE"'),
                               (["--source", "v4l2:/dev/video99", "--output", folder / "x"], "camera cam1: /dev/video99: No such file or directory")]:
        for command in ("record", "snapshot"):
            done = throwcal(build, command, *arguments)
            assert done.returncode == 2 and message in done.stderr and done.stderr.count("\n") == 1, (command, done)


def main() -> None:
    build = pathlib.Path(sys.argv[sys.argv.index("--build") + 1])
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        box.simulate(build, folder, "--cameras", "2", "--width", "160", "--height", "120", "--focal", "120", "--fps", "30")
        films_have_a_time_for_each_frame(build, folder)
        ctrl_c_saves_what_was_filmed(build, folder)
        enter_after_the_throw_still_has_it(build, folder)
        ctrl_c_while_standing_by_ends_it(build, folder)
        a_snapshot_is_a_picture(build, folder)
        what_is_wrong_is_said(build, folder)


if __name__ == "__main__":
    main()
