#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""A disk that fills up while the box captures (ENOSPC), fails (EIO, by device mapper), is read-only: each is named and survived, and
nothing that the box told of is lost. On one kernel; on both with THROWCAL_LONG=1."""

import os
import pathlib
import subprocess
import sys
import tempfile

import vm

KERNELS = (12, 13) if os.environ.get("THROWCAL_LONG") else (12,)
RIG = ("--cameras", "2", "--width", "160", "--height", "120", "--focal", "120", "--fps", "30", "--seed", "3")


def main() -> None:
    build = pathlib.Path(sys.argv[sys.argv.index("--build") + 1]).resolve()
    for kernel in KERNELS:
        with tempfile.TemporaryDirectory() as folder:
            site = pathlib.Path(folder)
            subprocess.run([build / "throwcal", "simulate", "--output", site, *RIG], check=True, stdout=subprocess.DEVNULL)
            files = {name: build / name for name in ("throwcald", "throwcal")}
            files |= {"rig.toml": site / "rig.toml", "disk_guest.py": pathlib.Path(__file__).parent / "disk_guest.py"}
            result = vm.run_in_guest(kernel, files, "python3 disk_guest.py", 900, ("--icount", "--memory", "1536"))
        assert result.rc == 0, result.output[-3000:] + str({name: text[-3000:] for name, text in result.files.items()})
        told = [line for line in result.output.splitlines() if "disk:" in line or line.startswith("after it")]
        assert len(told) == 4, result.output
        print(f"kernel {kernel}:", *told, sep="\n", flush=True)


if __name__ == "__main__":
    main()
