#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Hard power-offs of a machine whose box captures onto a disk: what the box told of is on the disk, and every file can be read.

Twice on one kernel; 25 on each with THROWCAL_LONG=1."""

import os
import pathlib
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time

import vm

KERNELS, CUTS = ((12, 13), 25) if os.environ.get("THROWCAL_LONG") else ((13,), 2)
MOST_TELLINGS = 12  # the first life is cut soon after so many of them, another after fewer, at random; none: at any time
SOON_S, ANY_TIME_S, PATIENCE_S = 3.0, 25.0, 240
RIG = ("--cameras", "2", "--width", "320", "--height", "240", "--focal", "240", "--fps", "30", "--seed", "3")

SCRIPT = """
set -e
mkdir -p /run/disk
mount -t ext4 /dev/vdc /run/disk
python3 power_cut_client.py /run/disk/state /host/told $(cat what) 2> /host/log
"""


def tellings(share: pathlib.Path) -> int:
    told = share / "told"
    return len(told.read_text().splitlines()) if told.exists() else 0


def cut_after(wanted: int, machine: subprocess.Popen, share: pathlib.Path, dice: random.Random) -> None:
    before = tellings(share)
    deadline = time.monotonic() + PATIENCE_S
    while tellings(share) < before + wanted and machine.poll() is None and time.monotonic() < deadline:
        time.sleep(0.01)
    time.sleep(dice.uniform(0, SOON_S if wanted else ANY_TIME_S))
    machine.send_signal(signal.SIGUSR1)


def lives_end_by_a_power_cut(kernel: int, build: pathlib.Path, folder: pathlib.Path, dice: random.Random) -> None:
    share, disk = folder / "share", folder / "disk.ext4"
    share.mkdir()
    subprocess.run(["/sbin/mke2fs", "-qF", "-t", "ext4", disk, "64M"], check=True)
    subprocess.run([build.parent / "throwcal", "simulate", "--output", share, *RIG], check=True, stdout=subprocess.DEVNULL)
    for name in ("throwcald", "throwcal"):
        shutil.copy(build.parent / name, share)
    shutil.copy(pathlib.Path(__file__).parent / "power_cut_client.py", share)
    (share / "run.sh").write_text(SCRIPT)
    command = [pathlib.Path(__file__).parent / "run", "--kernel", str(kernel), "--timeout", "3000", "--icount", "--disk", disk]
    for life in range(CUTS + 1):
        is_last = life == CUTS
        (share / "what").write_text("look" if is_last else "")
        machine = subprocess.Popen([*command, share], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace")
        if not is_last:
            cut_after(dice.randint(0, MOST_TELLINGS) if life else MOST_TELLINGS, machine, share, dice)
        output = machine.communicate()[0]
        log = (share / "log").read_text(errors="replace") if (share / "log").exists() else ""
        assert machine.returncode == (0 if is_last else 75), f"life {life}: {machine.returncode}\n{output[-3000:]}\n{log[-3000:]}"
    checked = next(line for line in output.splitlines() if line.startswith("checked:"))
    told = (share / "told").read_text().splitlines()
    calibrations = sum("calibration" in line for line in told)
    print(f"kernel {kernel}: {CUTS} power cuts, the box had told {len(told)} times, {calibrations} of them of a calibration; {checked}", flush=True)
    assert calibrations, "no life lasted until the box told of a calibration"


def main() -> None:
    build = pathlib.Path(sys.argv[sys.argv.index("--build") + 1]).resolve() / "tests"
    seed = int(os.environ.get("THROWCAL_SEED", time.time()))
    print(f"seed {seed}", flush=True)
    for kernel in KERNELS:
        vm.need_image(kernel)
        with tempfile.TemporaryDirectory() as folder:
            lives_end_by_a_power_cut(kernel, build, pathlib.Path(folder), random.Random(seed + kernel))


if __name__ == "__main__":
    main()
