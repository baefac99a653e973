#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""The box from its start to its stop: it loses nothing that it acknowledged."""
import subprocess

import box

STOP_BOUND_S = 5.0  # the goal is 1 s; this machine may be loaded


def throws_are_captured_and_the_calibration_is_kept(the_box) -> dict:
    with box.Client(the_box.port) as client:
        hello = client.line()
        assert hello["method"] == "hello" and hello["params"]["schema"] == "throwcal/calibration/1", hello
        assert hello["params"]["cameras"] == ["cam1", "cam2", "cam3", "cam4"], hello
        assert client.call("hello") == hello["params"]
        assert client.answer("calibration.latest")["error"] == {"code": -32000, "message": "there is no calibration yet"}
        assert client.answer("capture.start")["error"]["code"] == -32001
        assert client.answer("auth", {"token": the_box.token + "0"})["error"]["code"] == -32001
        assert client.answer("capture.start")["error"]["code"] == -32001
        client.may_change(the_box.token)
        assert client.answer("capture.stop")["error"]["code"] == -32000
        assert client.answer("capture.start", {"until": "later"})["error"]["code"] == -32602
        started = client.call("capture.start", {"until": "stopped"})
        assert started["state"] in ("warming-up", "capturing"), started
        assert "already" in client.answer("capture.start")["error"]["message"]
        box.until(lambda: client.call("status.get")["throws"] >= 3, "three throws found")
        stopped = client.call("capture.stop")
        assert stopped["state"] == "solving" and stopped["session"] == started["session"], stopped
        done = box.until(lambda: (s := client.call("status.get"))["state"] == "done" and s, "the session is solved")
        assert done["throws"] >= 3 and done["fault"] is None, done
        assert all(camera["flights"] >= 3 for camera in done["cameras"]), done
        calibration = client.call("calibration.latest")
        assert calibration["schema"] == "throwcal/calibration/1" and calibration["verdict"] == done["verdict"], calibration
        assert len(calibration["throws"]) >= 3, calibration
        assert all(camera["T_world_cam"] for camera in calibration["cameras"]), calibration
        return calibration


def the_commands_work(the_box, folder) -> None:
    def throwcal(*arguments):
        return subprocess.run([the_box.build / "throwcal", *arguments, "--host", f"127.0.0.1:{the_box.port}"],
                              capture_output=True, text=True)

    status = throwcal("status")
    assert status.returncode == 0 and status.stdout.startswith("idle: 0 throws"), status
    fetched = throwcal("fetch", "--output", str(folder / "calibration.json"), "--truth", str(folder / "truth.json"))
    assert fetched.returncode in (0, 3) and "cam4" in fetched.stdout, fetched
    assert (folder / "calibration.json").exists()
    print(fetched.stdout)
    cameras = throwcal("status", "--json")
    assert cameras.returncode == 0 and '"cam1"' in cameras.stdout, cameras


def story(build, folder) -> None:
    box.simulate(build, folder)
    with box.running_box(build, folder) as the_box:
        print(f"ready after {the_box.start_s:.2f} s")
        calibration = throws_are_captured_and_the_calibration_is_kept(the_box)
        took = the_box.stop()
        print(f"stopped in {took:.2f} s")
        assert took < STOP_BOUND_S
    with box.running_box(build, folder) as the_box:
        with box.Client(the_box.port) as client:
            client.line()
            assert client.call("calibration.latest") == calibration
            assert client.call("calibration.get", {"id": calibration["id"]}) == calibration
            assert [c["id"] for c in client.call("calibration.list")] == [calibration["id"]]
        the_commands_work(the_box, folder)
        with box.Client(the_box.port) as client:
            client.line()
            assert client.answer("capture.start")["error"]["code"] == -32001, "each connection shows the token anew"
            second = client.may_change(the_box.token).call("capture.start", {"until": "stopped"})["session"]
            box.until(lambda: client.call("status.get")["throws"] >= 2, "two throws found")
            client.call("capture.stop")
        the_box.stop()  # at once: the result is still being made, or just so
    with box.running_box(build, folder) as the_box, box.Client(the_box.port) as client:
        client.line()
        box.until(lambda: client.call("status.get")["state"] in ("done", "idle"), "it is solved now")  # idle: it was before
        latest = client.call("calibration.latest")
        assert latest["session"] == second and len(latest["throws"]) >= 2, latest
        the_box.stop()


if __name__ == "__main__":
    box.main(story)
