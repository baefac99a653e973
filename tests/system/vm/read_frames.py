#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""read_frames.py DEVICE COUNT BUFFERS: streams from a V4L2 device of whatever format it has; a line "SEQUENCE STAMP_NS FLAGS LEAST MOST" a
frame, the last two of its bytes. For what v4l2-ctl does not tell: the stamps of frames whose stamps were copied."""
import fcntl
import mmap
import struct
import sys

REQBUFS, QUERYBUF, QBUF, DQBUF, STREAMON = 0xC0145608, 0xC0585609, 0xC058560F, 0xC0585611, 0x40045612
CAPTURE, MMAP = 1, 1
BUFFER = struct.Struct("5I4x2q16x2IQ2Ii4x")  # v4l2_buffer on a 64-bit machine


def call(device, request: int, index: int = 0) -> tuple:
    """The v4l2_buffer that an ioctl answers."""
    buffer = bytearray(BUFFER.pack(index, CAPTURE, 0, 0, 0, 0, 0, 0, MMAP, 0, 0, 0, 0))
    fcntl.ioctl(device, request, buffer)
    return BUFFER.unpack(buffer)


def main(path: str, count: int, buffers: int) -> None:
    with open(path, "rb+", buffering=0) as device:
        request = bytearray(struct.pack("5I", buffers, CAPTURE, MMAP, 0, 0))
        fcntl.ioctl(device, REQBUFS, request)
        maps = []
        for index in range(struct.unpack_from("I", request)[0]):
            *_, offset, length, _, _ = call(device, QUERYBUF, index)
            maps.append(mmap.mmap(device.fileno(), length, offset=offset))
            call(device, QBUF, index)
        fcntl.ioctl(device, STREAMON, struct.pack("i", CAPTURE))
        for _ in range(count):
            index, _, size, flags, _, s, us, sequence, *_ = call(device, DQBUF)
            pixels = maps[index][:size]
            print(sequence, (s * 1_000_000 + us) * 1000, hex(flags), min(pixels), max(pixels), flush=True)
            call(device, QBUF, index)


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]))
