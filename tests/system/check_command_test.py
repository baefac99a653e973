#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""throwcald --check: what it understood, what it does not know, what is wrong; and nothing is opened."""

import pathlib
import re
import subprocess
import sys

import box


def check(build: pathlib.Path, file: pathlib.Path, *options: str) -> subprocess.CompletedProcess:
    return subprocess.run([build / "throwcald", "--check", "--config", file, *options], capture_output=True, text=True, timeout=box.PATIENCE_S)


def story(build: pathlib.Path, folder: pathlib.Path) -> None:
    source = pathlib.Path(sys.argv[sys.argv.index("--source") + 1])
    manual = check(build, source / "firmware" / "throwcald.toml")
    assert manual.returncode == 0 and manual.stderr == "", manual
    assert manual.stdout.endswith("throwcald.toml: ok\n") and "north: 1280x720, radtan, v4l2:" in manual.stdout, manual
    print(manual.stdout)
    box.simulate(build, folder)
    rig = (folder / "rig.toml").read_text()
    odd = folder / "odd.toml"
    odd.write_text(rig + '[sight]\nx = 1\n[button]\nkey = ["KEY_RECORD", "KEY_A"]\ngpio = "gpiochip0:17"\n')
    said = check(build, odd, "--state-dir", str(folder / "state"))
    assert f"HTTP 0.0.0.0:8080\nCAN: none\nstate folder {folder}/state; token in {folder}/state/token\n" in said.stdout, said
    assert said.returncode == 0 and "button: KEY_RECORD, KEY_A, gpiochip0:17; light: none" in said.stdout, said
    assert said.stderr.count("\n") == 1 and "sight is not a known key" in said.stderr, said
    assert not (folder / "state").exists(), "nothing is made"
    elsewhere = rig.replace("[daemon]\n", '[daemon]\nstate_dir = "/a"\ntoken_file = "/b"\n')
    on_a_bus = elsewhere + '\n[can]\ninterface = "can0"\nunit = 3\nfd = true\n'
    odd.write_text(re.sub(r"(\[http\]\n)listen = .*", r'\1listen = "127.0.0.1:9"', on_a_bus))
    said = check(build, odd)
    assert "HTTP 127.0.0.1:9\nCAN: can0, unit 3, documents in FD frames\nstate folder /a; token in /b\n" in said.stdout, said
    assert "; HTTP off\n" in check(build, odd, "--http-listen", "off").stdout
    for wrong, why in (
        (rig.replace('source = "simulated"', "", 1), 'camera "cam1" has no source'),
        (re.sub("listen = .*", "listen = 7", rig), "listen must be"),
        (rig + "[button\n", "not TOML"),
        (rig + '[button]\nkey = "RECORD"\n', "key must be a key's name"),
    ):
        odd.write_text(wrong)
        said = check(build, odd)
        assert said.returncode == 2 and why in said.stderr and said.stderr.count("\n") == 1 and said.stdout == "", said
    assert check(build, folder / "nowhere.toml").returncode == 2
    with box.running_box(build, folder) as the_box:  # the same ports and the same state: --check needs neither
        assert check(build, folder / "rig.toml", "--listen", f"127.0.0.1:{the_box.port}", "--state-dir", str(folder / "state")).returncode == 0
        the_box.stop()


if __name__ == "__main__":
    box.main(story)
