#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""systemd's watchdog is petted while all moves, and no more once a camera hangs without a word, though the main loop goes on."""

import box


def pets(the_box: box.Box) -> int:
    return the_box.notices.count("WATCHDOG=1")


def story(build, folder) -> None:
    box.simulate(build, folder, "--cameras", "2", "--width", "160", "--height", "120", "--focal", "120")
    hang = folder / "hang"
    with box.running_box(build, folder, WATCHDOG_USEC="500000", LD_PRELOAD=str(build / "tests" / "libhang_camera.so"), HANG=str(hang)) as the_box:
        with box.Client(the_box.port) as client:
            client.line()
            box.until(lambda: client.call("status.get")["cameras"][1]["frames"] > 0, "frames")
            box.until(lambda: pets(the_box) >= 10, "it is petted")
            hang.touch()
            box.until(lambda: 'camera "cam2" hangs' in (folder / "log").read_text(), "it is told which one hangs")
            before, began = pets(the_box), client.call("status.get")
            box.until(lambda: client.call("status.get")["uptime_s"] > began["uptime_s"] + 3, "its main loop goes on")
            now = client.call("status.get")["cameras"]
            assert now[0]["frames"] > began["cameras"][0]["frames"] and now[1]["frames"] == began["cameras"][1]["frames"], now
            assert pets(the_box) == before, "petted though a camera hangs"
            print(f"petted {before} times; in 3 s with a camera that hangs not once")


if __name__ == "__main__":
    box.main(story)
