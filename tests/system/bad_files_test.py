#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Bad files, each bad in one way: exit status 2, one clear line on standard error, nothing written. And good files that only look odd.
Run by hand with --show, it prints what each case is told."""
import json
import subprocess
import sys

import box

HEADER = "camera,time_s,u_px,v_px,radius_px,throw\n"


class Site:
    """A good rig, its sightings and a guess, and calibrations with one of them spoilt."""

    def __init__(self, build, folder):
        self.build, self.folder = build, folder
        box.simulate(build, folder, "--throws", "6")
        self.rig, self.sightings = ((folder / name).read_text() for name in ("rig.toml", "sightings.csv"))
        self.rows = self.sightings.splitlines(keepends=True)[1:]
        self.truth = json.loads((folder / "truth.json").read_text())

    def calibrate(self, *arguments) -> subprocess.CompletedProcess:
        output = self.folder / "out.json"
        output.unlink(missing_ok=True)
        return subprocess.run([self.build / "throwcal", "calibrate", "--output", output, *map(str, arguments)], capture_output=True)

    def with_file(self, name: str, content: str | bytes | None) -> subprocess.CompletedProcess:
        """With another rig, sightings or guess; None: a folder of that name."""
        files = {"rig": self.folder / "rig.toml", "sightings": self.folder / "sightings.csv"}
        path = files[name] = self.folder / f"other.{name}"
        if content is None:
            path = files[name] = self.folder / "a_folder"
            path.mkdir(exist_ok=True)
        else:
            path.write_bytes(content.encode() if isinstance(content, str) else content)
        return self.calibrate(*(item for kind, file in files.items() for item in (f"--{kind}", file)))

    def expect_refusal(self, what: str, done, *words: str) -> None:
        told = done.stderr.decode()  # strictly: bytes that are no text are never passed on
        assert done.returncode == 2 and done.stdout == b"", (what, done)
        assert told.startswith("throwcal: ") and told.endswith("\n") and told.count("\n") == 1, (what, done)
        assert told[:-1].isprintable() and len(told) < 500, (what, done)
        assert all(word in told for word in words), (what, words, told)
        assert not (self.folder / "out.json").exists(), what
        if "--show" in sys.argv:
            print(f"{what}: {told[:-1].replace(str(self.folder) + '/', '')}")


def row(camera="cam1", time_s="0.5", u_px="100", v_px="100", radius_px="", throw="1") -> str:
    return ",".join((camera, time_s, u_px, v_px, radius_px, throw)) + "\n"


def bad_cells() -> dict[str, tuple[str, tuple[str, ...]]]:
    """One bad cell in line 3."""
    cases = {}
    for column, expected in (("time_s", "a number of seconds from -4e+09 to 4e+09"), ("u_px", "a number of pixels from -1e+05 to 1e+05"),
                             ("v_px", "a number of pixels from -1e+05 to 1e+05"), ("radius_px", "a number of pixels from 0.01 to 1120")):
        for bad in ("nan", "inf", "-inf", "1e300", "-1e300", "0x10", "abc", "1 2", "1.2.3", "1e", "--1", "+-1", "١"):
            cases[f"{column} {bad}"] = (HEADER + row() + row(time_s="0.6" if column != "time_s" else bad, **{column: bad}
                                        if column != "time_s" else {}), (":3: ", f"{column} must be {expected}, got "))
    for column in ("time_s", "u_px", "v_px"):
        cases[f"{column} empty"] = (HEADER + row(**{column: ""}), (":2: ", f"{column} must be", 'got ""'))
    for bad in ("0", "-1", "1e-300"):
        cases[f"radius_px {bad}"] = (HEADER + row(radius_px=bad), (":2: ", "radius_px must be", f'got "{bad}"'))
    return cases


def bad_sightings(site: Site) -> None:
    five = [row(c, f"0.{i}") for c in ("cam1", "cam2") for i in range(5)]
    three = [row(c, f"{t}.{i}", throw=str(t)) for t in range(9) for c in ("cam1", "cam2") for i in range(3)]
    cases = bad_cells() | {
        "empty file": ("", ("is empty; expected at least a header",)),
        "blank lines": ("\n\r\n  \n", ("is empty; expected at least a header",)),
        "no throw (header only)": (HEADER, ("holds no sighting; expected at least a header and one row",)),
        "no header": ("".join(site.rows), (":1: ", "column camera is missing; expected the header camera,time_s,u_px,v_px")),
        "a folder": (None, ("can't be read: Is a directory",)),
        "missing column": ("camera,time_s,u_px\ncam1,0,1\n", (":1: ", "column v_px is missing; expected the header")),
        "duplicate column": ("camera,time_s,u_px,v_px,u_px\ncam1,0,1,1,1\n", (":1: ", "column u_px stands twice; expected it once")),
        "a cell too many": (HEADER + row() + row(throw="1,2"), (":3: ", "expected 6 columns as in the header, got 7")),
        "a cell too few": (HEADER + "cam1,0.5,1,1\n", (":2: ", "expected 6 columns as in the header, got 4")),
        "decimal comma": (HEADER + row(u_px='"1,5"'), (":2: ", 'u_px must be', 'got "1,5"')),
        "semicolons": (HEADER.replace(",", ";") + row().replace(",", ";"), (":1: ", "column camera is missing")),
        "quote left open": (HEADER + row(camera='"cam1'), (":2: ", "expected 6 columns as in the header, got 1")),
        "unknown camera": (HEADER + row("cam9"), (":2: ", 'camera "cam9" is not in the rig file; expected one of cam1, cam2, cam3, cam4')),
        "empty camera": (HEADER + row(""), (":2: ", 'camera "" is not in the rig file')),
        "binary junk": (bytes(range(256)) * 40, (":1: ", "column camera is missing")),
        "binary junk in a row": (HEADER.encode() + bytes(range(128, 256)) + b",0,1,1,,\n", (":2: ", 'camera "\\x80', "...")),
        "NUL bytes": (HEADER + row("ca\0m1"), (":2: ", 'camera "ca\\x00m1" is not in the rig file')),
        "a file of NUL bytes": (b"\0" * 4096, (":1: ", "column camera is missing")),
        "UTF-16": (site.sightings.encode("utf-16"), (":1: ", "column camera is missing")),
        "terminal codes": (HEADER + row("\x1b[2J"), (":2: ", 'camera "\\x1B[2J"')),
        "huge line": (HEADER + "x" * 5_000_000, (":2: ", "expected 6 columns as in the header, got 1")),
        "huge cell": (HEADER + row(u_px="1" * 5_000_000), (":2: ", "u_px must be", '1..."')),
        "one camera": (HEADER + "".join(r for r in site.rows if r.startswith("cam1,")),
                       ('all sightings are of camera "cam1"; expected those of two cameras or more',)),
        "one camera, no labels": (HEADER + "".join(r.rsplit(",", 1)[0] + ",\n" for r in site.rows if r.startswith("cam2,")),
                                  ('all sightings are of camera "cam2"; expected those of two cameras or more',)),
        "throws of 3 points": (HEADER + "".join(three), ('the longest throw, "0", has only 3 sightings by one camera', "expected 5 or more")),
        "one ball at two places": (HEADER + row() + row("cam2") + row(u_px="101"),
                                   (":4: ", 'camera "cam1" sees throw "1" at this time in line 2 already; expected one row a frame')),
        "pasted twice": (HEADER + "".join(site.rows + site.rows), (f":{2 + len(site.rows)}: ", "in line 2 already; expected one row a frame")),
        "pasted twice with its header": (site.sightings * 2, (f":{2 + len(site.rows)}: ", 'camera "camera" is not in the rig file')),
        "one label for all": (HEADER + "".join(five) + row(time_s="100000"), ('throw "1" lasts 100000 s; expected one flight, 20 s at most',)),
    }
    for what, (content, words) in cases.items():
        site.expect_refusal(f"sightings, {what}", site.with_file("sightings", content), "other.sightings" if content is not None else "a_folder", *words)


NUMBERS = {  # what a key of camera 1, or of another table, must be
    "width_px": "a whole number from 1 to 65536", "height_px": "a whole number from 1 to 65536",
    "fx_px": "a number from 1 to 1e+06", "fy_px": "a number from 1 to 1e+06", "cx_px": "a number from -1e+06 to 1e+06",
    "cy_px": "a number from -1e+06 to 1e+06", "skew_px": "a number from -1e+06 to 1e+06", "row_time_s": "a number of seconds from 0 to 0.01",
    "sigma_px": "a number from 1e-06 to 100", "sigma_common_px": "a number from 1e-06 to 100",
    "gravity_mps2": "a number of m/s^2 from 0.1 to 100", "latitude_deg": "a latitude in degrees from -90 to 90",
    "altitude_m": "a height in metres from -500 to 9000", "diameter_m": "a number of metres from 0.001 to 5",
    "mass_kg": "a number of kilograms from 1e-04 to 100", "drag_coefficient": "a number from 0 to 10",
    "position_m": "a number from 1e-09 to 1e+06", "rotation_rad": "a number from 1e-09 to 1e+06"}
TABLES = {"gravity_mps2": "site", "latitude_deg": "site", "altitude_m": "site", "diameter_m": "ball", "mass_kg": "ball", "drag_coefficient": "ball",
          "position_m": "target", "rotation_rad": "target"}
MAY_BE_ZERO = {"cx_px", "cy_px", "skew_px", "row_time_s", "latitude_deg", "altitude_m", "drag_coefficient"}
MAY_BE_NEGATIVE = {"cx_px", "cy_px", "skew_px", "latitude_deg", "altitude_m"}


def with_key(rig: str, key: str, value: str) -> str:
    """The rig file with one key of camera 1 or of its table set."""
    place = f"[{TABLES[key]}]\n" if key in TABLES else "[[camera]]\n"
    before, after = rig.split(place, 1)
    table, *rest = after.split("\n[", 1)
    lines = [line for line in table.splitlines() if not line.startswith(f"{key} =")]
    return before + place + f"{key} = {value}\n" + "\n".join(lines) + "\n" + "".join("\n[" + r for r in rest)


def bad_rigs(site: Site) -> None:
    rig = site.rig
    head, *cameras = rig.split("[[camera]]\n")
    cameras = ["[[camera]]\n" + camera for camera in cameras]
    cases = {}
    for key, expected in NUMBERS.items():
        bad = ["nan", "inf", "1e300", "-1e300", '"7"', "true", "[1]"]
        bad += [] if key in MAY_BE_ZERO else ["0", "1e-300"]
        bad += [] if key in MAY_BE_NEGATIVE else ["-1"]
        for value in bad:
            cases[f"{key} = {value}"] = (with_key(rig, key, value), (f"{key} must be {expected}, got ",))
    for value, expected in (("[0.1]", "4 or 5 numbers"), ("[0, 0, 0, 0, 0, 0]", "4 or 5 numbers"), ("[0, 0, nan, 0]", "got nan"),
                            ("[1e300, 0, 0, 0]", "got 1e+300"), ('["a", 0, 0, 0]', 'got "a"'), ("3", "a list of numbers, got 3")):
        cases[f"distortion = {value}"] = (with_key(rig, "distortion", value), ('camera "cam1": distortion must be', expected))
    cases |= {
        "kb4 with 5 coefficients": (rig.replace('"radtan"', '"kb4"', 1), ("distortion must be 4 numbers (k1 to k4) for a kb4 lens",)),
        "lens = \"pinhole\"": (with_key(rig, "lens", '"pinhole"'), ('lens must be "radtan" or "kb4", got "pinhole"',)),
        "lens = 4": (with_key(rig, "lens", "4"), ('lens must be "radtan" or "kb4", got 4',)),
        "lens with a line break": (with_key(rig, "lens", '"a\\nb\\u0000"'), ('got "a\\x0Ab\\x00"',)),
        "huge lens": (with_key(rig, "lens", '"' + "x" * 1_000_000 + '"'), ('x..."',)),
        "width_px = 12.5": (with_key(rig, "width_px", "12.5"), ("width_px must be a whole number", "got 12.5")),
        "row_time_s = 0.009": (with_key(rig, "row_time_s", "0.009"), ("row_time_s must be short enough", "got 0.009")),
        "no fx_px": (rig.replace("fx_px", "# fx_px", 1), ("fx_px is missing; expected a number",)),
        "no name": (rig.replace("name", "# name", 1), ("camera 1: name is missing; expected",)),
        "name = 1": (with_key(rig, "name", "1"), ("name must be a text in quotes, got 1",)),
        "name of 33 letters": (with_key(rig, "name", f'"{"a" * 33}"'), ("name must be 1 to 32 of the letters",)),
        "duplicate names": (rig.replace('"cam2"', '"cam1"'), ('camera 2: name must be unique among the cameras, got "cam1"',)),
        "one camera": (head + cameras[0], ("expected 2 to 64 [[camera]] tables, got 1",)),
        "no camera": (head, ("expected 2 to 64 [[camera]] tables, got 0",)),
        "65 cameras": (head + "".join(cameras[0].replace("cam1", f"c{i}") for i in range(65)), ("expected 2 to 64 [[camera]] tables, got 65",)),
        "[camera] for [[camera]]": (head + cameras[0].replace("[[camera]]", "[camera]"), ("camera must be a list of tables, written [[camera]]",)),
        "site = 3": ("site = 3\n" + "".join(cameras), (":1: ", "site must be a table, written [site]")),
        "drag = \"lots\"": (rig.replace('"estimate"', '"lots"', 1), ('[ball] drag must be "none", "from-ball" or "estimate", got "lots"',)),
        "drag from a ball without mass": (rig.replace('"estimate"', '"from-ball"', 1), ("[ball] mass_kg is missing; expected it",)),
        "a ball lighter than air": (rig.replace("[ball]\n", "[ball]\nmass_kg = 0.0001\n").replace("0.0657", "5"), ("mass_kg must be that of a ball",)),
        "offsets = true": (rig.replace('offsets = "estimate"', "offsets = true"), ('[timing] offsets must be "estimate" or "none", got true',)),
        "duplicate key": (rig.replace("[ball]\n", "[ball]\ndrag = \"none\"\n"), ("not TOML: ",)),
        "not TOML": ("[site\n" + rig, (":1: not TOML: ",)),
        "a table without a name": ("[.a]\n" + rig, (":1: not TOML: ",)),
        "binary junk": (bytes(range(256)), (":1: not TOML: ",)),
        "NUL bytes": (rig.replace("fx_px", "\0", 1), ("not TOML: ",)),
        "huge line": ("x" * 5_000_000, (":1: not TOML: ",)),
        "nested without end": ("a = " + "[" * 100_000, (":1: not TOML: ",)),
        "empty file": ("", ("expected 2 to 64 [[camera]] tables, got 0",)),
        "a folder": (None, ("can't be read: Is a directory",)),
        "unknown key, then a bad one": (with_key("colour = 1\n" + rig, "fx_px", "nan"), ("fx_px must be",)),
    }
    for what, (content, words) in cases.items():
        site.expect_refusal(f"rig, {what}", site.with_file("rig", content), "other.rig" if content is not None else "a_folder", *words)


def bad_guesses(site: Site) -> None:
    def spoilt(spoil) -> str:
        document = json.loads(json.dumps(site.truth))
        spoil(document)
        return json.dumps(document)

    def pose(key, value):
        return spoilt(lambda d: d["cameras"][1]["T_world_cam"].update({key: value}))

    def camera(key, value):
        return spoilt(lambda d: d["cameras"][1].update({key: value}))

    cases = {
        "NaN": (pose("translation_m", [0, float("nan"), 0]), ("not JSON: ",)),
        "1e999": (pose("translation_m", [0, 77.5, 0]).replace("77.5", "1e999"), ("not JSON: ", "1e999")),
        "1e300 m": (pose("translation_m", [0, 1e300, 0]), ('camera "cam2" T_world_cam translation_m must be a number of metres', "got 1e+300")),
        "two coordinates": (pose("translation_m", [0, 0]), ("translation_m must be a list of 3 numbers, got 2 values",)),
        "quaternion of length 2": (pose("quaternion_wxyz", [2, 0, 0, 0]), ("quaternion_wxyz must be of length 1, got 2",)),
        "quaternion of 1e300": (pose("quaternion_wxyz", [1e300, 1e300, 0, 0]), ("quaternion_wxyz must be of length 1",)),
        "quaternion of zero": (pose("quaternion_wxyz", [0, 0, 0, 0]), ("quaternion_wxyz must be of length 1, got 0",)),
        "text in a quaternion": (pose("quaternion_wxyz", ["1", 0, 0, 0]), ("quaternion_wxyz must be a finite number", 'got "1"')),
        "offset of an hour": (camera("time_offset_s", 3600), ("time_offset_s must be a number of seconds from -10 to 10, got 3600",)),
        "drag of 1e300": (spoilt(lambda d: d.update(drag_per_m=1e300)), ("drag_per_m must be a number from -1 to 10, got 1e+300",)),
        "no pose": (camera("T_world_cam", None), ('camera "cam2" has no T_world_cam',)),
        "another's name": (camera("name", "cam1"), ('camera "cam1" stands twice; expected it once',)),
        "wrong name": (camera("name", "east"), ('camera "cam2" is missing; expected every camera of the rig file',)),
        "no cameras": ("{}", ("cameras must be a list, got nothing",)),
        "a list": ("[1]", ("must be a calibration (a JSON object)",)),
        "empty file": ("", ("not JSON: ",)),
        "binary junk": (bytes(range(256)), ("not JSON: ",)),
        "nested without end": ("[" * 1_000_000, ("not JSON: ",)),
        "nested deeply": ('{"cameras": ' + "[" * 1_000_000 + "]" * 1_000_000 + "}", ("cameras name must be a text, got nothing",)),
        "a folder": (None, ("can't be read: Is a directory",)),
    }
    for what, (content, words) in cases.items():
        site.expect_refusal(f"guess, {what}", site.with_file("guess", content), "other.guess" if content is not None else "a_folder", *words)


def bad_frame_times(site: Site) -> None:
    folder = site.folder / "video"
    box.simulate(site.build, folder, "--video", "--throws", "1", "--cameras", "2", "--width", "64", "--height", "48", "--focal", "48", "--fps", "10")
    videos = [item for c in ("cam1", "cam2") for item in ("--video", f"{c}={folder / c}.mkv")]
    times = folder / "cam2.timestamps.txt"
    header, *lines = times.read_text().splitlines()
    cases = {
        "backward": ("\n".join([header, *lines[:5], lines[3], *lines[6:]]), (", line 7: ", "is not after the frame before it; times must ascend")),
        "twice the same": ("\n".join([header, *lines[:5], lines[4], *lines[6:]]), (", line 7: ", "times must ascend")),
        "NaN": (f"{header}\nnan\n", (", line 2: ", '"nan" is no time; expected milliseconds')),
        "1e300": (f"{header}\n1e300\n", (", line 2: ", '"1e300" is no time')),
        "too large": (f"{header}\n9999999999999\n", (", line 2: ", "is no time")),
        "binary junk": (bytes(range(256)), (", line 1: ", "is no time; expected milliseconds")),
        "too few": ("\n".join([header, *lines[:5]]), ("5 times, but the video has more frames; expected a line for each",)),
        "empty": ("", ("0 times, but the video has more frames",)),
    }
    for what, (content, words) in cases.items():
        times.write_bytes(content if isinstance(content, bytes) else content.encode())
        site.expect_refusal(f"timestamps, {what}", site.calibrate("--rig", folder / "rig.toml", *videos), "cam2.timestamps.txt", *words)
    site.expect_refusal("one video", site.calibrate("--rig", folder / "rig.toml", *videos[:2]), 'camera "cam1" is alone; expected the videos of two')


def odd_but_good(site: Site) -> None:
    """Nothing but the bytes around the numbers differs, so nothing of the result does."""
    def poses(content) -> str:
        done = site.with_file("sightings", content)
        assert done.returncode == 0 and done.stderr == b"", done
        document = json.loads((site.folder / "out.json").read_text())
        del document["created_utc"]
        return json.dumps(document)

    expected = poses(site.sightings)
    assert poses(site.sightings.replace("\n", "\r\n")) == expected
    assert poses("\ufeff" + site.sightings) == expected
    assert poses(site.sightings.replace(",", " , ").rstrip()) == expected
    assert poses(HEADER.replace("\n", ",colour\n") + "".join(r.replace("\n", ",red\n") for r in site.rows)) == expected
    backward = sorted(site.rows, key=lambda r: float(r.split(",")[1]), reverse=True)
    assert poses(HEADER + "".join(backward)) == expected, "rows may come in any order"
    assert poses(HEADER + "".join(sorted(site.rows))) == expected, "rows may come in any order"


def story(build, folder) -> None:
    site = Site(build, folder)
    odd_but_good(site)
    bad_sightings(site)
    bad_rigs(site)
    bad_guesses(site)
    bad_frame_times(site)


if __name__ == "__main__":
    box.main(story)
