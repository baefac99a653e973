#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""The clients that the README shows, each against a box of its own."""

import json
import pathlib
import subprocess
import sys

import box

CLIENTS = pathlib.Path(__file__).parent / "clients"
CLIENT_PATIENCE_S = 120


def run(client: str, folder, *arguments: str) -> dict:
    """What a client leaves in a folder of its own."""
    place = folder / client
    place.mkdir()
    subprocess.run([sys.executable, CLIENTS / client, *arguments], cwd=place, check=True, timeout=CLIENT_PATIENCE_S)
    return json.loads((place / "calibration.json").read_text())


def fails(client: str, folder, *arguments: str) -> str:
    """What it says with a token that is not the box's."""
    done = subprocess.run([sys.executable, CLIENTS / client, *arguments], cwd=folder, capture_output=True, text=True, timeout=CLIENT_PATIENCE_S)
    assert done.returncode != 0 and not (folder / "calibration.json").exists(), done
    return done.stderr


def the_readme_shows_them() -> None:
    readme = (CLIENTS.parent.parent.parent / "README.md").read_text()
    for client in sorted(CLIENTS.glob("*_client.py")):
        code = "\n".join(client.read_text().splitlines()[2:]).strip()
        assert f"```python\n{code}\n```" in readme, f"README.md must show {client.name} as it is"


def story(build, folder) -> None:
    the_readme_shows_them()
    box.simulate(build, folder, "--cameras", "2", "--width", "320", "--height", "240", "--focal", "240", "--fps", "60")
    with box.running_box(build, folder) as the_box, box.Client(the_box.port) as judge:
        page = f"http://127.0.0.1:{the_box.http_port}"
        assert "401" in fails("http_client.py", folder, page, "not-the-token")
        assert "KeyError: 'result'" in fails("tcp_client.py", folder, "127.0.0.1", "not-the-token", str(the_box.port))
        assert judge.call("status.get")["session"] is None
        ways = [("http_client.py", page, the_box.token), ("tcp_client.py", "127.0.0.1", the_box.token, str(the_box.port))]
        for client, *arguments in ways:
            got = run(client, folder, *arguments)
            assert got == judge.call("calibration.latest") and len(got["throws"]) >= 3, got
            print(f"{client}: session {got['session']}, {len(got['throws'])} throws, {got['verdict']}")
        the_box.stop()


if __name__ == "__main__":
    box.main(story)
