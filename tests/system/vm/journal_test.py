#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""What the box tells systemd's journal: entries with fields, by its own protocol. journal_guest.py stands in for journald."""

import pathlib
import subprocess
import sys
import tempfile

import vm

HERE = pathlib.Path(__file__).parent


def main() -> None:
    build = pathlib.Path(sys.argv[sys.argv.index("--build") + 1])
    with tempfile.TemporaryDirectory() as folder:
        site = pathlib.Path(folder)
        size = ["--cameras", "2", "--width", "160", "--height", "120", "--focal", "120", "--fps", "15"]
        subprocess.run([build / "throwcal", "simulate", "--output", site, *size], check=True, stdout=subprocess.DEVNULL)
        first, second, third = (site / "rig.toml").read_text().replace("cam2", "east").partition('name = "east"')
        rig = first + second + third.replace('source = "simulated"', 'source = "v4l2:/dev/nowhere"')
        files = {"throwcald": build / "throwcald", "rig.toml": rig, "journal_guest.py": HERE / "journal_guest.py"}
        result = vm.run_in_guest(13, files, "python3 -u journal_guest.py > out/said 2>&1", 600, ("--icount",))
    said = result.files.get("said", b"").decode()
    print(f"{result.total_s:.0f} s: {said}", flush=True)
    assert result.rc == 0, result.output


if __name__ == "__main__":
    main()
