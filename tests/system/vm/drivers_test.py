#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""What the virtual machine promises other tests, on both kernels: four vivid cameras that deliver frames, four loopback devices
whose readers get the footage that was played and its very stamps."""
import pathlib
import re
import sys
import tempfile

import vm

KERNELS = {12: "6.1", 13: "6.12"}  # by Debian's version
WIDTH, HEIGHT, FPS, FRAMES = 160, 120, 20, 100
BUFFERS = 8  # of a loopback device
OFFSETS_NS = (0, 1_234_000, 12_345_000, -7_000_000)  # of each device's stamps

SCRIPT = f"""
set -e
modprobe vivid n_devs=4 node_types=0x1,0x1,0x1,0x1
modprobe v4l2loopback devices=4 video_nr=20,21,22,23 max_buffers={BUFFERS}
udevadm settle
for node in /dev/video*; do v4l2-ctl --device $node --info > out/info.${{node#/dev/}}; done
v4l2-ctl --device /dev/video0 --set-fmt-video width=320,height=180,pixelformat=GREY --stream-mmap --stream-count=30 --verbose 2> out/vivid

./loopback_player {WIDTH} {HEIGHT} GREY {FPS} {" ".join(f"/dev/video{20 + i}=footage{i}+{ns}" for i, ns in enumerate(OFFSETS_NS))} \\
  > out/written &
while [ ! -s out/written ]; do kill -0 $!; sleep 0.05; done
for i in 0 1 2 3; do python3 read_frames.py /dev/video2$i 30 {BUFFERS} > out/read$i & done
wait
"""


def check(kernel: int, footage: dict[str, pathlib.Path], player: pathlib.Path) -> None:
    result = vm.run_in_guest(kernel, {"loopback_player": player, "read_frames.py": vm.HERE / "read_frames.py", **footage}, SCRIPT, 200, ("--icount",))
    assert result.rc == 0, f"kernel {kernel}: exit status {result.rc}\n{result.output}"
    assert f"begins on Linux {KERNELS[kernel]}." in result.output, result.output
    cameras = [name for name in result.files if name.startswith("info.") and re.search("Driver name *: vivid", result.text(name))]
    assert len(cameras) == 4, cameras
    assert result.text("vivid").count("cap dqbuf") == 30, result.text("vivid")

    written = [line.split() for line in result.text("written").splitlines()]
    for i, offset_ns in enumerate(OFFSETS_NS):
        frame_of = {int(stamp): int(frame) for device, frame, stamp in written if device == f"/dev/video{20 + i}"}
        read = [line.split() for line in result.text(f"read{i}").splitlines()]
        assert len(read) == 30, (i, read)
        wrong = [k for k, (_, stamp, _, *pixels) in enumerate(read)
                 if int(stamp) not in frame_of or {int(p) for p in pixels} != {brightness(i, frame_of[int(stamp)])}]
        assert all(k < BUFFERS for k in wrong), (i, wrong, read, frame_of)  # what lay there when the reader came has its own stamps
        first = min(int(stamp) for device, _, stamp in written if device == "/dev/video20")
        assert min(frame_of) - first == offset_ns, (i, min(frame_of) - first)
    print(f"kernel {kernel}: script began after {result.boot_s:.1f} s, all took {result.total_s:.1f} s", flush=True)


def brightness(device: int, frame: int) -> int:
    return (60 * device + frame) % 256


def main() -> None:
    build = pathlib.Path(sys.argv[sys.argv.index("--build") + 1])
    with tempfile.TemporaryDirectory() as folder:
        footage = {f"footage{i}": pathlib.Path(folder) / f"footage{i}" for i in range(4)}
        for i, path in enumerate(footage.values()):
            path.write_bytes(b"".join(bytes([brightness(i, frame)]) * (WIDTH * HEIGHT) for frame in range(FRAMES)))
        for kernel in KERNELS:
            check(kernel, footage, build / "tests" / "loopback_player")


if __name__ == "__main__":
    main()
