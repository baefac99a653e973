#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""The box's button and light on real kernel devices (uinput, LED class, gpio-sim): button_guest.py is what happens in the guest.
THROWCAL_LONG=1: both kernels, else one."""

import json
import os
import pathlib
import re
import subprocess
import sys
import tempfile

import vm

KERNELS = (12, 13) if os.environ.get("THROWCAL_LONG") else (13,)


def patterns(source: pathlib.Path) -> dict[str, list[int]]:
    """What firmware/README.md promises of the light, by state."""
    rows = [row.split("|")[1:-1] for row in (source / "firmware" / "README.md").read_text().splitlines() if row.count("|") == 5]
    found = {row[0].strip(): [int(ms) for ms in row[2].split()] for row in rows if row[2].replace(" ", "").isdigit()}
    assert {"idle", "capturing", "done", "fault"} <= found.keys(), found
    return found


def main() -> None:
    build, source = (pathlib.Path(sys.argv[sys.argv.index(option) + 1]) for option in ("--build", "--source"))
    with tempfile.TemporaryDirectory() as folder:
        site = pathlib.Path(folder)
        size = ["--cameras", "2", "--width", "160", "--height", "120", "--focal", "120", "--fps", "15"]
        subprocess.run([build / "throwcal", "simulate", "--output", site, *size], check=True, stdout=subprocess.DEVNULL)
        rig = re.sub("throw_interval_s = .*", "throw_interval_s = 60", (site / "rig.toml").read_text())  # a throw would be shown, too
        files = {"throwcald": build / "throwcald", "rig.toml": rig, "patterns.json": json.dumps(patterns(source))}
        files["button_guest.py"] = pathlib.Path(__file__).parent / "button_guest.py"
        for kernel in KERNELS:
            result = vm.run_in_guest(kernel, files, "python3 -u button_guest.py patterns.json > out/said 2>&1", 1500, ("--icount",))
            said = result.files.get("said", b"").decode()
            print(f"kernel {kernel}: {result.total_s:.0f} s\n{said}", flush=True)
            assert result.rc == 0, f"exit status {result.rc}\n{result.output}\n{result.files.get('throwcald.log', b'').decode()}"


if __name__ == "__main__":
    main()
