#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""A box whose cameras are films: a capture ends with them, and one that begins after them ends at once."""

import box


def story(build, folder) -> None:
    box.simulate(build, folder, "--cameras", "2", "--width", "160", "--height", "120", "--focal", "120", "--fps", "30", "--throws", "2", "--video")
    rig = (folder / "rig.toml").read_text()
    for name in ("cam1", "cam2"):
        rig = rig.replace('source = "simulated"', f'source = "video:{name}.mkv"', 1)
    (folder / "rig.toml").write_text(rig)
    with box.running_box(build, folder) as the_box, box.Client(the_box.port) as client:
        client.line()
        client.may_change(the_box.token)
        box.until(lambda: not any(camera["running"] for camera in client.call("status.get")["cameras"]), "the films are over")
        box.until(lambda: "every camera has ended" in (folder / "log").read_text(), "and the box knows it")
        for n in (1, 2):
            assert client.call("capture.start", {"until": "stopped"})["session"] == n
            box.until(lambda: client.call("status.get")["state"] == "done", "the capture ends by itself")
        print([session["state"] for session in client.call("session.list")])
        the_box.stop()


if __name__ == "__main__":
    box.main(story)
