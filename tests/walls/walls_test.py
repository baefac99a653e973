#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""The walls between the rooms: which room may include what, and that the estimator asks the C library for nothing whose last bit depends on
the machine. What is forbidden fails with its file and line."""
import argparse
import pathlib
import re
import subprocess
import sys

VOCABULARY = {"time", "observation", "rigid", "camera_model", "ballistics", "rig_description"}
INCLUDE = re.compile(r'^\s*#\s*include\s*([<"])([^>"]+)[>"]')
STANDARD = re.compile(r"^[a-z_0-9]+$")  # <vector>, <cmath>: the C++ library's headers have no dot
NOT_IN_ESTIMATOR = {"thread", "mutex", "condition_variable", "future", "fstream", "iostream", "random", "filesystem", "stop_token"}
# What IEEE 754 doesn't fix to the bit (it does sqrt; fmod, frexp, floor and the like are exact): estimator/elementary.h has it.
INEXACT = r"(?:a?(?:sin|cos|tan)h?|atan2|sincos|exp(?:2|10|m1)?|log(?:2|10|1p)?|pow|hypot|cbrt|fma|erfc?|[lt]gamma)"
CALL = re.compile(rf"\bstd::{INEXACT}\b")
SYMBOL = re.compile(rf"^ +U ({INEXACT}[fl]?)$", re.MULTILINE)


def verdict(room: str, kind: str, name: str) -> str | None:
    """Why a room may not include a header, or None where it may."""
    target = name.split("/")[0] if kind == '"' else None
    if kind == '"' and target not in ("estimator", "capture", "firmware", "tests"):
        return "a quoted include is root-relative and names its room"
    if room == "tests":
        return None
    if target == "tests":
        return "nothing includes tests/"
    if room == "estimator":
        if target is not None and target != "estimator":
            return "estimator/ uses Eigen and std only"
        if kind == "<" and not (name.startswith("Eigen/") or STANDARD.match(name)):
            return "estimator/ uses Eigen and std only"
        if name in NOT_IN_ESTIMATOR:
            return "estimator/ opens no file, starts no thread, prints nothing and draws no random numbers"
    if room == "capture":
        if target == "firmware":
            return "capture/ does not know firmware/"
        if target == "estimator" and pathlib.PurePath(name).stem not in VOCABULARY:
            return f"of estimator/ capture/ uses the vocabulary only: {', '.join(sorted(VOCABULARY))}"
    return None


def broken_walls(source: pathlib.Path) -> tuple[list[str], int]:
    """Every forbidden include, and how many files were read."""
    found, files = [], 0
    for room in ("estimator", "capture", "firmware", "tests"):
        for path in sorted((source / room).rglob("*")):
            if path.suffix not in (".h", ".cpp"):
                continue
            files += 1
            for number, line in enumerate(path.read_text().splitlines(), 1):
                match = INCLUDE.match(line)
                why = match and verdict(room, match[1], match[2])
                if why:
                    found.append(f"{path.relative_to(source)}:{number}: {line.strip()}: {why}")
    return found, files


def inexact_calls(source: pathlib.Path) -> list[str]:
    """Where the estimator's source calls the C library's mathematics."""
    lines = ((path, number, line.split("//")[0]) for path in sorted((source / "estimator").iterdir()) if path.suffix in (".h", ".cpp")
             for number, line in enumerate(path.read_text().splitlines(), 1))
    return [f"{path.relative_to(source)}:{number}: {line.strip()}: use estimator/elementary.h" for path, number, line in lines if CALL.search(line)]


def inexact_symbols(symbols: str) -> list[str]:
    """What the compiled estimator wants of the C library's mathematics, Eigen's calls included."""
    return [f"libestimator.a: {name}: use estimator/elementary.h" for name in sorted(set(SYMBOL.findall(symbols)))]


def proves_itself() -> None:
    """A check that cannot fail is none: each wall once, and what is allowed."""
    forbidden = [("estimator", '"', "capture/frame.h"), ("estimator", "<", "opencv2/core.hpp"), ("estimator", "<", "thread"),
                 ("estimator", "<", "fstream"), ("estimator", '"', "firmware/config.h"), ("capture", '"', "estimator/ekf.h"),
                 ("capture", '"', "firmware/daemon.h"), ("firmware", '"', "tests/support/thrower.h"), ("capture", '"', "frame.h")]
    allowed = [("estimator", "<", "Eigen/Dense"), ("estimator", "<", "vector"), ("capture", '"', "estimator/time.h"),
               ("capture", "<", "opencv2/core.hpp"), ("firmware", '"', "estimator/calibrate.h"), ("tests", '"', "capture/rig.h")]
    assert all(verdict(*case) for case in forbidden), [c for c in forbidden if not verdict(*c)]
    assert not any(verdict(*case) for case in allowed), [c for c in allowed if verdict(*c)]
    assert all(CALL.search(f"x = std::{name}(y);") for name in ("sin", "acos", "atan2", "exp", "log1p", "pow", "hypot"))
    assert not any(CALL.search(f"x = {name}(y);") for name in ("elementary::sin", "std::sqrt", "std::floor", "std::expected", "exp_so3"))
    nm = "a.o:\n                 U sincos\n0000000000000000 T sin\n                 U sqrt\n                 U powf\n                 U _Z3cosd\n"
    assert len(inexact_symbols(nm)) == 2, inexact_symbols(nm)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--source", type=pathlib.Path, required=True)
    parser.add_argument("--build", type=pathlib.Path)
    proves_itself()
    arguments = parser.parse_args()
    found, files = broken_walls(arguments.source)
    found += inexact_calls(arguments.source)
    if arguments.build and (library := arguments.build / "libestimator.a").exists():
        found += inexact_symbols(subprocess.run(["nm", "-u", library], capture_output=True, text=True, check=True).stdout)
    print("\n".join(found) or f"{files} files, no wall is broken")
    return 1 if found or files == 0 else 0


if __name__ == "__main__":
    sys.exit(main())
