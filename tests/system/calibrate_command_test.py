#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""The offline commands as scripts use them: files, exit statuses, and one clear line for every unusable input."""
import csv
import json
import subprocess

import box


def run(build, *arguments) -> subprocess.CompletedProcess:
    return subprocess.run([build / "throwcal", *map(str, arguments)], capture_output=True, text=True)


def sightings_become_a_calibration(build, folder) -> None:
    output, residuals = folder / "calibration.json", folder / "residuals.csv"
    done = run(build, "calibrate", "--rig", folder / "rig.toml", "--sightings", folder / "sightings.csv", "--output", output,
               "--residuals", residuals)
    assert done.returncode == 0 and "verdict: accepted" in done.stdout and done.stderr == "", done
    document = json.loads(output.read_text())
    assert document["verdict"] == "accepted" and len(document["throws"]) == 6, document
    with open(residuals) as file, open(folder / "sightings.csv") as read:
        rows = list(csv.DictReader(file))
        assert len(rows) == len(list(csv.DictReader(read)))
    used = [row for row in rows if row["used"] == "1"]
    assert len(used) == sum(c["sightings_used"] for c in document["cameras"])
    assert all(abs(float(row["residual_u_px"])) < 2 for row in used)
    again = run(build, "calibrate", "--rig", folder / "rig.toml", "--sightings", folder / "sightings.csv", "--guess", output, "--json")
    assert again.returncode == 0, again
    for one, other in zip(json.loads(again.stdout)["cameras"], document["cameras"]):
        for a, b in zip(one["T_world_cam"]["translation_m"], other["T_world_cam"]["translation_m"]):
            assert abs(a - b) < 1e-4, (one, other)
    drawn = run(build, "picture", output)
    assert drawn.returncode == 0 and drawn.stdout.startswith("<svg"), drawn


def too_little_is_said_with_status_3(build, folder) -> None:
    """Two cameras that saw one short throw: a calibration can begin, and says what it lacks."""
    header, *rows = (folder / "sightings.csv").read_text().splitlines()
    first = [row for row in rows if row.endswith(",1")]
    few, output = folder / "few.csv", folder / "few.json"
    few.write_text("\n".join([header, *(row for camera in ("cam1", "cam2") for row in [r for r in first if r.startswith(camera)][:6])]) + "\n")
    done = run(build, "calibrate", "--rig", folder / "rig.toml", "--sightings", few, "--output", output)
    document = json.loads(output.read_text())
    assert done.returncode == 3 and document["verdict"] == "unobservable" and document["reasons"], (done, document)


def unusable_input_is_one_line_and_nothing_is_written(build, folder) -> None:
    rig, sightings, output = folder / "rig.toml", folder / "sightings.csv", folder / "no.json"
    bad_rig, bad_sightings, bad_guess = folder / "bad.toml", folder / "bad.csv", folder / "bad.json"
    bad_rig.write_text(rig.read_text().replace("drag = ", "drag = 7 #"))
    bad_sightings.write_text("camera,time_s,u_px,v_px\ncam1,0,1,2\ncam9,0,1,2\n")
    bad_guess.write_text('{"cameras": []}')
    cases = [(["--rig", folder / "none.toml", "--sightings", sightings], "none.toml: can't be opened: No such file"),
             (["--rig", bad_rig, "--sightings", sightings], "drag must be"),
             (["--rig", rig, "--sightings", bad_sightings], 'bad.csv:3: camera "cam9" is not in the rig file'),
             (["--rig", rig, "--sightings", folder], "can't be read: Is a directory"),
             (["--rig", rig, "--sightings", sightings, "--guess", bad_guess], 'bad.json: camera "cam1" is missing'),
             (["--rig", rig, "--sightings", sightings, "--method", "magic"], "magic"),
             (["--rig", rig], "expected --sightings FILE or --video NAME=PATH"),
             (["--rig", rig, "--video", "cam1"], "expected NAME=PATH"),
             (["--rig", rig, "--video", f"cam9={sightings}"], '"cam9" is not in the rig file'),
             (["--rig", rig, "--video", f"cam1={sightings}"], "sightings.csv"),
             (["--sightings", sightings], "--rig")]
    for arguments, message in cases:
        done = run(build, "calibrate", *arguments, "--output", output)
        assert done.returncode == 2 and message in done.stderr, (arguments, done)
        assert done.stderr.count("\n") == 1 and done.stdout == "", (arguments, done)
        assert not output.exists(), arguments
    unwritable = run(build, "calibrate", "--rig", rig, "--sightings", sightings, "--output", folder / "no" / "such.json")
    assert unwritable.returncode == 2 and "such.json: can't be written" in unwritable.stderr, unwritable


def videos_become_a_calibration(build, folder) -> None:
    box.simulate(build, folder, "--video", "--throws", "2", "--cameras", "2", "--width", "320", "--height", "240", "--focal", "240")
    truth = json.loads((folder / "truth.json").read_text())
    output = folder / "calibration.json"
    videos = [item for c in truth["cameras"] for item in ("--video", f"{c['name']}={folder / c['name']}.mkv")]
    done = run(build, "calibrate", "--rig", folder / "rig.toml", *videos, "--output", output)
    assert done.returncode in (0, 3) and done.stderr == "", done
    document = json.loads(output.read_text())
    print(done.stdout)
    first, second = document["cameras"]
    error = [a - b for a, b in zip(second["T_world_cam"]["translation_m"], truth["cameras"][1]["T_world_cam"]["translation_m"])]
    assert sum(e * e for e in error) ** 0.5 < 0.2, (error, document)  # two small pictures, two throws


def videos_become_sightings_and_pictures(build, folder) -> None:
    """`detect` finds the same flights with a rig file and without, and what it writes can be calibrated by."""
    sightings, calibration = folder / "seen.csv", folder / "seen.json"
    videos = [f"{name}={folder / name}.mkv" for name in ("cam1", "cam2")]
    done = run(build, "detect", "--rig", folder / "rig.toml", *videos, "--output", sightings, "--overlay", folder / "seen.png")
    assert done.returncode == 0 and done.stderr == "" and "throws that two cameras or more saw: " in done.stdout, done
    with open(sightings) as file:
        rows = list(csv.DictReader(file))
    flown = [row for row in rows if row["throw"]]
    assert {row["camera"] for row in flown} == {"cam1", "cam2"} and len(flown) > 80, (len(flown), done.stdout)
    assert all(0 < float(row["sigma_u_px"]) < 1 and row["partial"] in "01" and float(row["radius_px"]) > 1 for row in flown)
    frames = json.loads((folder / "truth.json").read_text())["frames"]
    balls = {(name, round(1e4 * f["time_s"])): f for name, listed in frames.items() for f in listed if f["is"] != "hand"}
    errors = [float(row[f"{axis}_px"]) - ball[f"{axis}_px"] for row in flown for axis in "uv"
              if (ball := balls.get((row["camera"], round(1e4 * float(row["time_s"])))))]
    assert len(errors) == 2 * len(flown), "what is in a throw is the ball in flight"
    assert (sum(e * e for e in errors) / len(errors)) ** 0.5 < 0.1, errors
    picture = (folder / "seen.png").read_bytes()
    assert picture.startswith(b"\x89PNG") and int.from_bytes(picture[16:20], "big") == 640, picture[:30]
    done = run(build, "calibrate", "--rig", folder / "rig.toml", "--sightings", sightings, "--output", calibration)
    assert done.returncode in (0, 3) and json.loads(calibration.read_text())["cameras"][1]["T_world_cam"], done
    done = run(build, "detect", folder / "cam1.mkv", "--output", sightings, "--overlay", folder / "seen.mkv")
    assert done.returncode == 0 and done.stderr == "", done
    with open(sightings) as file:
        alone = list(csv.DictReader(file))
    assert sum(row["throw"].startswith("cam1-") for row in alone) > 40, done.stdout
    film = run(build, "detect", folder / "seen.mkv")  # what was drawn is a film of the same length
    frames = [line.split()[1] for line in (done.stdout + film.stdout).splitlines() if line.startswith(("cam1", "seen"))]
    assert film.returncode == 0 and frames[0] == frames[1], (done, film)
    for arguments, message in [(["cam1.mkv"], "cam1.mkv: no such video file"),
                               ([folder / "cam1.mkv", "--overlay", "seen.jpg"], "--overlay seen.jpg: expected a name ending in .png or .mkv"),
                               ([folder / "cam1.mkv", "--overlay", folder / "no" / "seen.png"], "can't be written"),
                               ([folder / "cam1.mkv", "--ball-color", "red"], "--ball-color red: expected red, green and blue like #d7eb5a"),
                               ([folder / "cam1.mkv", folder / "cam1.mkv"], '"cam1" has a video already'),
                               (["--rig", folder / "rig.toml", f"cam9={folder / 'cam1.mkv'}"], '"cam9" is not in the rig file'),
                               ([], "videos is required")]:
        done = run(build, "detect", *arguments)
        assert done.returncode == 2 and message in done.stderr and done.stderr.count("\n") == 1, (arguments, done)


def nobody_answers(build) -> None:
    done = run(build, "status", "--host", "127.0.0.1:1")
    assert done.returncode == 1, done
    assert done.stderr == "throwcal: no box answers at 127.0.0.1:1 (Connection refused); is throwcald running?\n", done


def story(build, folder) -> None:
    box.simulate(build, folder, "--throws", "6")
    sightings_become_a_calibration(build, folder)
    too_little_is_said_with_status_3(build, folder)
    unusable_input_is_one_line_and_nothing_is_written(build, folder)
    (folder / "video").mkdir()
    videos_become_a_calibration(build, folder / "video")
    videos_become_sightings_and_pictures(build, folder / "video")
    nobody_answers(build)


if __name__ == "__main__":
    box.main(story)
