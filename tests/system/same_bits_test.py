#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""The same bits on every machine: tests/data/same_bits (three cameras, one of them kb4, three throws, unlabelled) gives the document whose
SHA-256 stands here, whatever the processor, the compiler and the C library; also where that library is told to use none of the processor's
extensions. A change of the estimator or of the document changes the sums: this test then prints the new ones, to be written here once it is
clear that the change was meant."""

import hashlib
import os
import pathlib
import re
import subprocess
import sys

import box

EXPECTED = {
    "full": "8e296ca06f9f24ebcd28bedff323b55fdceae13f2cc0af9a93ecc5286c55d2a6",
    "rb-ekf": "f52d3cb67b134b37d49173d49af59fac4928f60ca34695560598194da757d69a",
}
PLAIN = "glibc.cpu.hwcaps=-FMA,-FMA4,-AVX2,-AVX512F,-AVX"  # what the library chooses its functions by, on x86
# How often the C library's own functions answer otherwise then: that the test could fail.
LIBRARY = """import math, hashlib
for name in ("sin", "cos", "tan", "exp", "log", "atan"):
    print(name, hashlib.sha256(" ".join(getattr(math, name)(i / 7919).hex() for i in range(1, 40000)).encode()).hexdigest())"""


def with_extensions(used: bool) -> dict:
    return dict(os.environ) if used else {**os.environ, "GLIBC_TUNABLES": PLAIN}


def sum_of(build, folder, method: str, environment: dict) -> str:
    """Of the calibration document, without when and by which version it was made."""
    data, output = pathlib.Path(__file__).parents[1] / "data" / "same_bits", folder / "calibration.json"
    command = [build / "throwcal", "calibrate", "--rig", data / "rig.toml", "--sightings", data / "sightings.csv", "--method", method]
    done = subprocess.run([*command, "--output", output], capture_output=True, text=True, env=environment)
    assert done.returncode in (0, 3) and done.stderr == "", done
    document, replaced = re.subn(rb'"(created_utc|software)": "[^"]*"', b"", output.read_bytes())
    assert replaced == 2, document[:200]
    return hashlib.sha256(document).hexdigest()


def story(build, folder) -> None:
    def told(used: bool) -> list[str]:
        return subprocess.run(
            [sys.executable, "-c", LIBRARY], capture_output=True, text=True, check=True, env=with_extensions(used)
        ).stdout.splitlines()

    different = [a.split()[0] for a, b in zip(told(True), told(False)) if a != b]
    print(f"of the C library's functions {', '.join(different) or 'none'} depend on this processor")
    sums = {(method, used): sum_of(build, folder, method, with_extensions(used)) for method in EXPECTED for used in (True, False)}
    for (method, used), value in sums.items():
        print(f"{method}, {'all' if used else 'none'} of the processor's extensions in the C library: {value}")
    for (method, used), value in sums.items():
        assert value == EXPECTED[method], f"{method}: not the bits that all machines gave; if that was meant, the sums above are the new ones"


if __name__ == "__main__":
    box.main(story)
