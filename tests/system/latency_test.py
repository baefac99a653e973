#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""How soon a throw is in a calibration that a client has: from its last sighting, and from when it was told to be found.

Prints p50 and p99 of 12 throws; of 100 with THROWCAL_LONG=1."""

import os
import time

import box

THROWS = 100 if os.environ.get("THROWCAL_LONG") else 12


def percentile(values: list[float], percent: float) -> float:
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(percent / 100 * len(ordered)))]


def tell(what: str, values: list[float]) -> None:
    print(f"{what}: p50 {1e3 * percentile(values, 50):.0f} ms, p99 {1e3 * percentile(values, 99):.0f} ms, of {len(values)}", flush=True)


def story(build, folder) -> None:
    box.simulate(build, folder)  # four cameras of 640x480
    from_last_sighting, from_found = {}, []
    with box.running_box(build, folder) as the_box, box.Client(the_box.port) as client, box.Client(the_box.port) as reader:
        client.line(), reader.line()
        client.may_change(the_box.token).call("capture.start", {"until": "stopped"})
        status, found_at, last_id, flights = client.call("status.subscribe"), None, None, 0
        while len(from_last_sighting) < THROWS:
            now = time.monotonic()
            if (seen := sum(camera["flights"] for camera in status["cameras"])) != flights:
                flights, found_at = seen, now  # the last camera's flight makes the throw whole
            if status["calibration"] and status["calibration"] != last_id:
                last_id = status["calibration"]
                document = reader.call("calibration.get", {"id": last_id})
                now = time.monotonic()  # the clock that the cameras' frames are stamped with
                if found_at and status["state"] == "capturing":
                    from_found.append(now - found_at)
                    found_at = None
                newest = max(document["throws"], key=lambda each: each["end_s"])
                from_last_sighting.setdefault(round(newest["start_s"], 1), now - newest["end_s"])
            message = client.line()
            status = message["params"] if message.get("method") == "status" else status
        dropped = [camera["frames_dropped"] + camera["frames_lost_by_driver"] for camera in client.call("status.get")["cameras"]]
        the_box.stop()
    tell("last sighting of a throw -> its calibration at a TCP client", list(from_last_sighting.values()))
    tell("a throw's last flight told to be found -> its calibration at a TCP client", from_found)
    print(f"frames lost meanwhile: {dropped} (drawing four cameras' pictures takes most of this machine)")
    assert min(from_last_sighting.values()) > 0, "a calibration can't be there before its throw is over"


if __name__ == "__main__":
    box.main(story)
