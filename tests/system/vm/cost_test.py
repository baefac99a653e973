#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""What a frame costs, beside `v4l2-ctl --stream-mmap`, which looks at no pixel, in the same machine: processor time, and how often the
picture is copied. v4l2-ctl is run for few frames and for many: the difference is the frames'; ours says it itself, from the first frame
on. THROWCAL_LONG=1: both kernels."""

import json
import os
import pathlib
import sys

import vm

KERNELS = (12, 13) if os.environ.get("THROWCAL_LONG") else (13,)
FEW, MANY = 40, 440
SIZES = ((320, 180), (640, 360))
FORMATS = ("GREY", "YUYV")
WAYS = ("mmap", "user", "ours")  # mapped buffers, buffers of the program's own, ours

SCRIPT = """
set -e
modprobe vivid n_devs=1 node_types=0x1
udevadm settle
TIMEFORMAT='%U %S'
cost() { # OUT COMMAND...
  local out=out/$1; shift
  { time LD_PRELOAD=./libcount_copies.so COPIES=$out.copies "$@" > out/log 2>&1; } 2> $out.time || { cat out/log; exit 1; }
}
stream() { cost $1 v4l2-ctl --device /dev/video0 --set-fmt-video=width=$2,height=$3,pixelformat=$4 --set-parm 25 --stream-$5=8 --stream-count=$6; }
"""


def script() -> str:
    lines = [SCRIPT]
    for width, height in SIZES:
        for form in FORMATS:
            for count in (FEW, MANY):
                name = f"{width}.{form}.{count}"
                lines += [f"stream mmap.{name} {width} {height} {form} mmap {count}", f"stream user.{name} {width} {height} {form} user {count}"]
                lines.append(f"cost ours.{name} ./grab {width}x{height} 300 fps=25 format={form} frames={count} /dev/video0")
                lines.append(f"cp out/log out/ours.{name}.json")
    return "\n".join(lines) + "\n"


def a_frame(result: vm.Result, way: str, size: tuple[int, int], form: str) -> tuple[float, float]:
    """Microseconds of processor time, and copies of the grey picture, of one frame."""
    used, copied = {}, {}
    for count in (FEW, MANY):
        name = f"{way}.{size[0]}.{form}.{count}"
        used[count] = sum(map(float, result.text(f"{name}.time").split()))
        copied[count] = int(result.text(f"{name}.copies"))
    frames = MANY - FEW
    if way == "ours":
        us = json.loads(result.text(f"ours.{size[0]}.{form}.{MANY}.json"))["cpu_us_a_frame"]
        return us, (copied[MANY] - copied[FEW]) / frames / (size[0] * size[1])
    return 1e6 * (used[MANY] - used[FEW]) / frames, (copied[MANY] - copied[FEW]) / frames / (size[0] * size[1])


def check(result: vm.Result) -> None:
    for size in SIZES:
        for form in FORMATS:
            costs = {way: a_frame(result, way, size, form) for way in WAYS}
            print(
                f"  {size[0]}x{size[1]} {form}: "
                + ", ".join(f"{way} {us:.0f} us" for way, (us, _) in costs.items())
                + f"; ours is {costs['ours'][0] / costs['mmap'][0]:.2f} of mmap; copies {costs['ours'][1]:.3f}",
                flush=True,
            )
            assert abs(costs["mmap"][1]) < 0.1, costs
            if form == "GREY":  # of YUYV the luma is taken out, by no memcpy
                assert 0.98 < costs["ours"][1] < 1.1, costs


def main() -> None:
    build = pathlib.Path(sys.argv[sys.argv.index("--build") + 1]) / "tests"
    files = {name: build / name for name in ("grab", "libcount_copies.so")}
    for kernel in KERNELS:
        result = vm.run_in_guest(kernel, files, script(), 1500, ("--icount",))
        print(f"kernel {kernel}: {result.total_s:.0f} s", flush=True)
        assert result.rc == 0, f"exit status {result.rc}\n{result.output}"
        check(result)


if __name__ == "__main__":
    main()
