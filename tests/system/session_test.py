#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""What the box keeps of a session: listed, fetched, repeated bit for bit elsewhere, unpacked, deleted; and a session that is thrown away."""

import csv
import json
import os
import sqlite3
import subprocess

import box


def command(the_box, *arguments, token=None, status=0) -> str:
    environment = {**os.environ, "LC_ALL": "C.UTF-8"}
    environment.pop("THROWCAL_TOKEN", None)
    if token:
        environment["THROWCAL_TOKEN"] = token
    remote = [] if arguments[0] == "calibrate" else ["--host", f"127.0.0.1:{the_box.port}"]
    done = subprocess.run(
        [the_box.build / "throwcal", *arguments, *remote], capture_output=True, text=True, env=environment, stdin=subprocess.DEVNULL
    )
    assert done.returncode == status, (arguments, done)
    return done.stdout + done.stderr


def captured(the_box, throws: int) -> int:
    """A session of so many throws; its number."""
    with box.Client(the_box.port) as client:
        client.line()
        session = client.may_change(the_box.token).call("capture.start", {"until": "stopped"})["session"]
        box.until(lambda: client.call("status.get")["throws"] >= throws, f"{throws} throws found")
        client.call("capture.stop")
        box.until(lambda: client.call("status.get")["state"] == "done", "the session is solved")
        return session


def a_session_ends_itself_at_the_target(the_box) -> int:
    with box.Client(the_box.port) as client:
        client.line()
        started = client.may_change(the_box.token).call("capture.start")
        assert started["ends_itself"] and started["target"]["throws"] == 3, started
        done = box.until(lambda: (s := client.call("status.get"))["state"] == "done" and s, "the session ends itself")
        assert done["verdict"] == "accepted" and done["throws"] >= 3, done
        assert done["worst_sigma_position_m"] <= done["target"]["position_m"], done
        assert done["advice"] == "fetch the calibration", done
        again = client.call("capture.stop")
        assert again["state"] == "done" and again["session"] == started["session"], "to stop what has ended is no error"
        return started["session"]


def it_is_repeated_bit_for_bit(the_box, session: int, folder) -> None:
    file = folder / "fetched.throwcal"
    command(the_box, "export", str(session), "--output", str(file))
    said = command(the_box, "calibrate", "--session", str(file), "--output", str(folder / "again.json"))
    assert "the same as the box's, bit for bit" in said, said
    with box.Client(the_box.port) as client:
        client.line()
        ours, theirs = json.loads((folder / "again.json").read_text()), client.call("calibration.latest")
        assert theirs.pop("session") == session and theirs.pop("id") // 10000 == session
        assert ours == theirs
    print(said.splitlines()[-1])


def it_is_listed_and_shown(the_box, session: int) -> None:
    listed = command(the_box, "sessions")
    assert f"\n{session:7d}  " in listed and " done " in listed and " accepted " in listed, listed
    shown = json.loads(command(the_box, "show", str(session), "--json"))
    assert shown["state"] == "done" and shown["calibrations"][-1]["verdict"] == "accepted" and shown["has_evidence"], shown
    assert f"there is no session {session + 1}" in command(the_box, "show", str(session + 1), status=1)
    assert "is not there" in command(the_box, "export", str(session + 1), "--output", "nowhere", status=1)


def a_part_beyond_its_file_is_refused(the_box, session: int) -> None:
    with box.Client(the_box.port) as client:
        client.line()
        size = client.call("session.read", {"session": session})["bytes"]
        assert client.call("session.read", {"session": session, "offset": size})["data"] == ""
        for offset in (-1, size + 1, 2**63 - 1, 2**63, 2**64 - 1, -(2**63)):
            error = client.answer("session.read", {"session": session, "offset": offset})["error"]
            assert error["code"] == -32602 and error["message"].startswith(f"offset must be 0 to {size}, "), (offset, error)
        for offset in ("0", 1.5, None, [0], 2**65, True):
            error = client.answer("session.read", {"session": session, "offset": offset})["error"]
            assert error["code"] == -32602 and error["message"].startswith("offset must be a whole number"), (offset, error)
        for number in (0, -1, 2**63, 2**64 - 1):
            assert client.answer("session.read", {"session": number})["error"]["code"] == -32000, number


def it_is_fetched_and_unpacked(the_box, session: int, folder) -> None:
    neighbour, out = folder / "at_once.throwcal", folder / "at_once"
    neighbour.write_text("somebody's own")
    command(the_box, "export", str(session), "--unpack", "--output", str(out))
    assert neighbour.read_text() == "somebody's own"
    assert (out / "session.throwcal").read_bytes() == (folder / "fetched.throwcal").read_bytes()
    for name in ("rig.toml", "sightings.csv", "calibration.json"):
        assert (out / name).read_bytes() == (folder / "unpacked" / name).read_bytes(), name


def it_is_unpacked(the_box, folder) -> None:
    file, out = folder / "fetched.throwcal", folder / "unpacked"
    command(the_box, "export", str(file), "--unpack", "--output", str(out))
    rows = list(csv.DictReader((out / "sightings.csv").open()))
    pictures = sorted(p.name for p in (out / "pictures").iterdir())
    backgrounds = [name for name in pictures if "_background_" in name]
    assert [name.split("_")[0] for name in backgrounds] == ["cam1", "cam2", "cam3", "cam4"], backgrounds
    kept = len(pictures) - len(backgrounds)
    print(f"{len(rows)} sightings, {kept} pictures of them, {file.stat().st_size / 1e6:.1f} MB")
    assert 0.95 * len(rows) <= kept <= len(rows) + 400, "a picture a sighting, also of those that came after the last calibration"
    assert (out / "rig.toml").read_bytes() == (folder / "rig.toml").read_bytes()
    said = command(the_box, "calibrate", "--rig", str(out / "rig.toml"), "--sightings", str(out / "sightings.csv"))
    assert "verdict: accepted" in said, said
    with sqlite3.connect(file) as database:
        assert database.execute("PRAGMA integrity_check").fetchall() == [("ok",)]


def a_damaged_session_is_one_error(the_box, folder) -> None:
    good = (folder / "fetched.throwcal").read_bytes()
    for name, data in [("empty", b""), ("text", b"hello\n" * 1000), ("half", good[: len(good) // 2]), ("head", good[:100])]:
        file = folder / f"{name}.throwcal"
        file.write_bytes(data)
        for arguments in [("calibrate", "--session", str(file)), ("show", str(file))]:
            said = command(the_box, *arguments, status=2)
            assert said.startswith(f"throwcal: {file}: ") and said.count("\n") == 1, said


def one_is_thrown_away(the_box) -> None:
    with box.Client(the_box.port) as client:
        client.line()
        client.may_change(the_box.token)
        latest = client.call("calibration.latest")
        session = client.call("capture.start")["session"]
        box.until(lambda: client.call("status.get")["throws"] >= 1, "a throw found")
        away = client.call("capture.abort")
        assert away["state"] == "idle" and away["session"] is None and away["throws"] == 0, away
        assert client.answer("capture.abort")["error"]["code"] == -32000
        assert client.call("calibration.latest") == latest
        assert client.call("session.get", {"session": session})["state"] == "aborted"
        again = client.call("capture.start", {"key": "once"})["session"]
        assert client.call("capture.start", {"key": "once"})["session"] == again == session + 1
        client.call("capture.abort")


def one_is_deleted(the_box, session: int, folder) -> None:
    assert "changes something" in command(the_box, "delete", str(session), "--yes", status=1)
    assert "is not the box's token" in command(the_box, "delete", str(session), "--yes", token="wrong-token", status=1)
    assert f"session {session} is deleted" in command(the_box, "delete", str(session), "--yes", token=the_box.token)
    assert f"there is no session {session}" in command(the_box, "show", str(session), status=1)
    assert not list((folder / "state" / "sessions").glob(f"{session:06d}*"))


def story(build, folder) -> None:
    box.simulate(build, folder)
    with box.running_box(build, folder) as the_box:
        session = a_session_ends_itself_at_the_target(the_box)
        it_is_listed_and_shown(the_box, session)
        it_is_repeated_bit_for_bit(the_box, session, folder)
        a_part_beyond_its_file_is_refused(the_box, session)
        it_is_unpacked(the_box, folder)
        it_is_fetched_and_unpacked(the_box, session, folder)
        a_damaged_session_is_one_error(the_box, folder)
        one_is_thrown_away(the_box)
        one_is_deleted(the_box, captured(the_box, 1), folder)
        the_box.stop()
    with box.running_box(build, folder) as the_box:
        it_is_listed_and_shown_after_a_restart = json.loads(command(the_box, "sessions", "--json"))
        assert [s["state"] for s in it_is_listed_and_shown_after_a_restart] == ["aborted", "aborted", "done"]
        it_is_repeated_bit_for_bit(the_box, session, folder)
        the_box.stop()


if __name__ == "__main__":
    box.main(story)
