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
    nobody_answers(build)


if __name__ == "__main__":
    box.main(story)
