#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""SIGHUP: what is safe is taken, what needs a restart is named, a broken file changes nothing; systemd is told."""

import re
import signal

import box

OF_A_BUSY_MACHINE = re.compile(r'<\d>(camera "|sightings dropped)')  # what the box tells by itself


def story(build, folder) -> None:
    box.simulate(build, folder, "--cameras", "2", "--width", "160", "--height", "120", "--focal", "120")
    file = folder / "rig.toml"
    rig = file.read_text()
    with box.running_box(build, folder) as the_box, box.Client(the_box.port) as client:

        def reload(text: str) -> str:
            """What the box says of it."""
            said = len((folder / "log").read_text())
            ready = the_box.notices.count("READY=1")
            file.write_text(text)
            the_box.process.send_signal(signal.SIGHUP)
            box.until(lambda: the_box.notices.count("READY=1") > ready, "it is ready again")
            lines = (folder / "log").read_text()[said:].splitlines(keepends=True)
            return "".join(line for line in lines if not OF_A_BUSY_MACHINE.match(line))

        client.line()
        client.may_change(the_box.token)
        assert reload(rig) == "", "nothing changed"
        began = the_box.notices.index("RELOADING=1")
        assert re.fullmatch(r"MONOTONIC_USEC=\d+", the_box.notices[began + 1]), the_box.notices
        named = rig.replace("[daemon]\n", '[daemon]\nunit = "box 7"\n')
        assert "[daemon] unit" in reload(named) and client.call("hello")["unit"] == "box 7"
        said = reload(named + "[button\n")
        assert "the configuration stays as it was: " in said and "not TOML" in said and said.count("\n") == 1, said
        assert client.call("hello")["unit"] == "box 7"
        said = reload(re.sub("position_m = .*", "position_m = -1", named))
        assert "the configuration stays as it was: " in said and "position_m must be" in said, said
        said = reload(re.sub("listen = .*", 'listen = "127.0.0.1:1"', named, count=1).replace("fx_px = ", "fx_px = 1", 1))
        assert "needs a restart: [[camera]] 1 fx_px, [daemon] listen\n" in said, said
        client.call("capture.start", {"until": "stopped"})
        wide = re.sub("position_m = .*", "position_m = 0.25", named)
        assert "for the next session: [target] position_m" in reload(wide)
        assert client.call("status.get")["target"]["position_m"] != 0.25, "not in the session under way"
        client.call("capture.abort")
        box.until(lambda: client.call("status.get")["target"]["position_m"] == 0.25, "after it")
        said = reload(wide + '[button]\nkey = "KEY_RECORD"\n[light]\nled = "nowhere"\n')
        assert "[button] key" in said and "[light] led" in said, said
        box.until(lambda: "no input device here with the key KEY_RECORD" in (folder / "log").read_text(), "the button is looked for")
        said = reload(wide + '[button]\nkey = "KEY_RECORD"\n[light]\nled = "elsewhere"\n')
        assert "[light] led" in said and "[button]" not in said, said
        box.until(lambda: "light: elsewhere: " in (folder / "log").read_text(), "the light is looked for")
        assert (folder / "log").read_text().count("no input device here with the key KEY_RECORD") == 1, "the button is left alone"
        print(the_box.notices.count("RELOADING=1"), "reloads")
        the_box.stop()


if __name__ == "__main__":
    box.main(story)
