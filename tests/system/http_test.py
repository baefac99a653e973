#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""The HTTP link: each route, each fault, and what a network sends; no camera loses a frame because of it."""

import base64
import hashlib
import http.client
import io
import json
import re
import socket
import tarfile

import box
from http_talk import Answer, Stream, ask, change, get, raw, status_of

WIDTH_PX, HEIGHT_PX = 320, 240
MAX_CONNECTIONS, MAX_STREAMS, MAX_BODY_BYTES = 16, 12, 64 * 1024
CHANGES = ("start", "stop", "abort")
SAMPLE = re.compile(r'([a-zA-Z_:][a-zA-Z0-9_:]*)(?:\{([a-zA-Z_]\w*="(?:[^"\\\n]|\\["\\n])*"(?:,[a-zA-Z_]\w*="(?:[^"\\\n]|\\["\\n])*")*)\})? (\S+)')


def jpeg_size(data: bytes) -> tuple[int, int]:
    """Width and height, by walking a JPEG's segments to its frame header; asserts that it begins and ends as one."""
    assert data[:2] == b"\xff\xd8" and data[-2:] == b"\xff\xd9", (data[:4], data[-4:])
    at = 2
    while data[at : at + 1] == b"\xff":
        marker, length = data[at + 1], int.from_bytes(data[at + 2 : at + 4], "big")
        if marker in (0xC0, 0xC1, 0xC2):
            return int.from_bytes(data[at + 7 : at + 9], "big"), int.from_bytes(data[at + 5 : at + 7], "big")
        at += 2 + length
    raise AssertionError("a JPEG without a frame header")


def balls_in(headers) -> list[tuple[float, float]]:
    return [tuple(float(n) for n in place.split(",")) for place in (headers.get("X-Balls") or "").split()]


def samples(text: str) -> dict[tuple, float]:
    """Prometheus' text format 0.0.4, strictly: HELP and TYPE once and before a metric's samples, which stand together and are unique."""
    assert text.endswith("\n") and "\r" not in text
    kinds, helped, closed, current, found = {}, set(), set(), None, {}
    for line in text.splitlines():
        if comment := re.fullmatch(r"# (HELP|TYPE) ([a-zA-Z_:][a-zA-Z0-9_:]*) (.+)", line):
            kind, name, rest = comment.groups()
            if kind == "HELP":
                assert name not in helped, line
                helped.add(name)
            else:
                assert name in helped and name not in kinds and rest in ("counter", "gauge"), line
                assert (rest == "counter") == name.endswith("_total"), line
                closed.add(current)
                kinds[name], current = rest, name
            continue
        sample = SAMPLE.fullmatch(line)
        assert sample, f"no sample: {line!r}"
        name, labels, value = sample.groups()
        assert name == current and name not in closed and (name, labels) not in found, line
        found[name, labels] = float(value)
        assert kinds[name] == "gauge" or found[name, labels] >= 0, line
    assert found and helped == set(kinds)
    return found


def every_route_answers(the_box) -> None:
    port = the_box.http_port
    types = {
        "/": "text/html; charset=utf-8",
        "/page.js": "text/javascript; charset=utf-8",
        "/page.css": "text/css; charset=utf-8",
        "/healthz": "text/plain; charset=utf-8",
        "/metrics": "text/plain; version=0.0.4; charset=utf-8",
        "/api/v1/status": "application/json",
        "/api/v1/cameras": "application/json",
        "/api/v1/system": "application/json",
        "/api/v1/calibration": "application/json",
        "/api/v1/support": "application/x-tar",
        "/api/v1/cameras/cam1/preview.jpg": "image/jpeg",
    }
    for path, kind in types.items():
        answer = get(port, path)
        assert (answer.status, answer.headers["Content-Type"]) == (200, kind), (path, answer.status, dict(answer.headers))
        assert answer.headers["X-Content-Type-Options"] == "nosniff", path
        head = ask(port, "HEAD", path)
        assert head.status == 200 and not head.body and head.headers["Content-Type"] == kind, (path, head.status)
        if path in ("/", "/page.js", "/api/v1/cameras", "/api/v1/calibration"):  # those that do not change
            assert int(head.headers["Content-Length"]) == len(answer.body), path
    for path in ("/api/v1/events", "/api/v1/cameras/cam2/preview.mjpeg"):
        assert ask(port, "HEAD", path).status == 200, path
    assert get(port, "/healthz").body == b"ok\n"
    with box.Client(the_box.port) as client:
        assert get(port, "/api/v1/cameras").json()[0].keys() == client.call("camera.list")[0].keys()
        assert get(port, "/api/v1/system").json().keys() == client.call("system.info").keys()
        assert get(port, "/api/v1/status").json().keys() == client.call("status.get").keys()


def the_page_is_whole_and_reaches_nothing_else(the_box) -> None:
    page = get(the_box.http_port, "/")
    policy = dict(part.strip().split(" ", 1) for part in page.headers["Content-Security-Policy"].split(";"))
    assert policy["default-src"] == "'none'" and policy["script-src"] == policy["style-src"] == policy["connect-src"] == "'self'", policy
    html = page.body.decode()
    for named in re.findall(r'(?:src|href)="([^"]*)"', html):
        assert named == "data:," or get(the_box.http_port, "/" + named).status in (200, 409), named  # 409: no calibration yet
    assert not re.search(r"<(script|style)[^>]*>[^<\s]|\son\w+=|\sstyle=", html), "inline: the policy forbids it"
    assert b"://" not in page.body + get(the_box.http_port, "/page.js").body + get(the_box.http_port, "/page.css").body


def each_fault_has_its_status(the_box) -> None:
    port = the_box.http_port
    for path, expected in [
        ("/nothing", (404, -32601)), ("/api/v1", (404, -32601)), ("/api/v2/status", (404, -32601)), ("/api/v1/status/", (400, -32600)),
        ("//", (400, -32600)), ("/api/v1/status%00", (400, -32600)), ("/%2e%2e/token", (404, -32601)), ("/../state/token", (404, -32601)),
        ("/api/v1/calibration/latest", (409, -32000)), ("/api/v1/calibration/7", (404, -32000)), ("/api/v1/calibration/seven", (400, -32602)),
        ("/api/v1/cameras/nobody/preview.jpg", (404, -32601)), ("/api/v1/cameras/nobody/preview.mjpeg", (404, -32601)),
    ]:  # fmt: skip
        assert get(port, path).error() == expected, (path, get(port, path).error())
    for method, path, allowed in [("POST", "/api/v1/status", "GET, HEAD"), ("DELETE", "/api/v1/calibration/1", "GET, HEAD"),
                                  ("PUT", "/", "GET, HEAD"), ("GET", "/api/v1/capture/start", "POST"), ("OPTIONS", "/metrics", "GET, HEAD")]:  # fmt: skip
        answer = ask(port, method, path)
        assert answer.error()[0] == 405 and answer.headers["Allow"] == allowed, (method, path)


def writes_without_the_token_are_refused(the_box) -> None:
    with box.Client(the_box.port) as client:
        known = [what for what in CHANGES if client.answer("capture." + what)["error"]["code"] != -32601]
    assert {"start", "stop"} <= set(known)
    for what in known:
        for headers in [{}, {"Authorization": "Bearer "}, {"Authorization": f"Bearer {the_box.token}0"}, {"Authorization": "Bearer x"},
                        {"Authorization": f"Basic {the_box.token}"}, {"Authorization": the_box.token}, {"X-Token": the_box.token},
                        {"Idempotency-Key": "k", "Authorization": f"Bearer {the_box.token[:-1]}"}]:  # fmt: skip
            answer = change(the_box, what, headers=headers)
            assert answer.error() == (401, -32001), (what, headers, answer.status)
            assert answer.headers["WWW-Authenticate"].startswith("Bearer "), dict(answer.headers)
        assert change(the_box, what + f"?token={the_box.token}").error() == (401, -32001), what
        foreign = change(the_box, what, the_box.token, {"Origin": "http://elsewhere"})
        assert foreign.error() == (403, -32001), foreign.status
    assert status_of(the_box)["session"] is None
    for what in set(CHANGES) - set(known):  # this box's JSON-RPC has no such method
        assert change(the_box, what, the_box.token).error() == (404, -32601), what
    print("refused without a token:", ", ".join(known))


def bodies_have_limits(the_box) -> None:
    port, token = the_box.http_port, the_box.token
    for body in (b"[]", b"7", b"{", b"\xff\xfe", b'{"a":1}x', b" " * MAX_BODY_BYTES):
        assert change(the_box, "stop", token, body=body).status == 400, body[:20]
    head = b"POST /api/v1/capture/stop HTTP/1.1\r\nHost: box\r\nAuthorization: Bearer " + token.encode() + b"\r\n"
    assert raw(port, head + b"Content-Length: %d\r\n\r\n" % (MAX_BODY_BYTES + 1)).startswith(b"HTTP/1.1 413 ")
    assert raw(port, head + b"Content-Length: 99999999999999999999999\r\n\r\n").startswith(b"HTTP/1.1 4")
    assert raw(port, head + b"Content-Length: -1\r\n\r\n").startswith(b"HTTP/1.1 4")
    chunk = b"1000\r\n" + b" " * 4096 + b"\r\n"
    chunked = head + b"Transfer-Encoding: chunked\r\n\r\n"
    assert raw(port, chunked + chunk * 17 + b"0\r\n\r\n").startswith(b"HTTP/1.1 413 ")
    assert raw(port, chunked + b"zz\r\n").startswith(b"HTTP/1.1 400 ")
    with socket.create_connection(("127.0.0.1", port), timeout=box.PATIENCE_S) as connection:
        try:
            connection.sendall(chunked)
            for _ in range(100_000):  # 400 MB, should nobody stop it
                connection.sendall(chunk)
        except OSError:
            pass
        else:
            raise AssertionError("the box took 400 MB of a body")


def heads_have_limits(the_box) -> None:
    port = the_box.http_port
    for many in (b"X-A: " + b"a" * 40_000 + b"\r\n", b"X-A: b\r\n" * 20_000):
        answer = raw(port, b"GET /api/v1/status HTTP/1.1\r\nHost: box\r\n" + many + b"\r\n")
        assert re.match(rb"HTTP/1.1 (431|413) ", answer), answer[:80]
    assert re.match(rb"HTTP/1.1 (414|431) ", raw(port, b"GET /" + b"a" * 40_000 + b" HTTP/1.1\r\nHost: box\r\n\r\n"))


def garbage_is_refused(the_box) -> None:
    port = the_box.http_port
    for data in (b"\r\n\r\nhello there\r\n\r\n", b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + bytes(range(256)) + b"\r\n\r\n", b"\0" * 100 + b"\r\n\r\n",
                 b"GET\r\n\r\n", b"GET /api/v1/status HTTP/9.9\r\n\r\n", b"GET /api/v1/status HTTP/1.1\r\n\r\n",
                 b"GET /api/v1/status HTTP/1.1\r\nHost: box\r\nno colon\r\n\r\n", b'{"jsonrpc":"2.0","id":1,"method":"hello"}\r\n\r\n'):  # fmt: skip
        answer = raw(port, data)
        assert answer == b"" or re.match(rb"HTTP/1.1 (400|404|405|505) ", answer), (data, answer[:80])
    assert status_of(the_box)["state"] == "idle"


def what_is_half_open_is_closed_and_hinders_nobody(the_box) -> None:
    port = the_box.http_port
    halves = [socket.create_connection(("127.0.0.1", port), timeout=box.PATIENCE_S) for _ in range(MAX_CONNECTIONS - 2)]
    for number, half in enumerate(halves):
        half.sendall(b"GET /api/v1/status HTTP/1.1\r\nHost: b"[: 3 * number])
    assert status_of(the_box)["state"] == "idle"
    for half in halves:
        answer = b""
        while piece := half.recv(4096):
            answer += piece
        assert answer == b"" or answer.startswith(b"HTTP/1.1 408 "), answer
        half.close()


def one_connection_too_many_is_told_so(the_box) -> None:
    port = the_box.http_port
    held = []
    for _ in range(MAX_CONNECTIONS):
        connection = http.client.HTTPConnection("127.0.0.1", port, timeout=box.PATIENCE_S)
        connection.request("GET", "/healthz")
        assert Answer(connection.getresponse()).status == 200
        held.append(connection)
    refused = get(port, "/api/v1/status")
    assert refused.error() == (503, -32000) and refused.headers["Retry-After"] and refused.headers["Connection"] == "close", refused.status
    for connection in held:  # those that are there are served on
        connection.request("GET", "/healthz")
        assert Answer(connection.getresponse()).status == 200
        connection.close()
    box.until(lambda: get(port, "/healthz").status == 200, "there is room again")


def streams_leave_room_for_questions(the_box) -> None:
    port = the_box.http_port
    streams = [Stream(port, "/api/v1/events") for _ in range(MAX_STREAMS)]
    assert get(port, "/api/v1/events").error() == (503, -32000)
    assert status_of(the_box)["state"] == "idle"
    for stream in streams:
        with stream:
            assert stream.event()[0] == "status"
    box.until(lambda: samples(get(port, "/metrics").body.decode())["throwcal_http_connections", None] <= 2, "streams that were left are gone")


def many_come_and_go(the_box) -> None:
    """Memory stays: what a thousand requests and half requests took is given back."""
    port = the_box.http_port

    def load(rounds: int) -> float:
        for number in range(rounds):
            get(port, "/api/v1/status")
            with socket.create_connection(("127.0.0.1", port)) as half:
                half.sendall(b"GET /api/v1/events HTTP/1.1\r\nHost: box\r\n"[: 10 + number % 32] + b"\r\n" * (number % 2))
        return samples(get(port, "/metrics").body.decode())["process_resident_memory_bytes", None]

    before = load(300)
    after = load(1000)
    print(f"memory: {before / 1e6:.1f} MB, after 2000 more connections {after / 1e6:.1f} MB")
    assert after < before + 8e6


def pictures_come_with_the_ball_ringed(the_box) -> None:
    port = the_box.http_port
    still = get(port, "/api/v1/cameras/cam1/preview.jpg")
    assert jpeg_size(still.body) == (WIDTH_PX, HEIGHT_PX)
    with Stream(port, "/api/v1/cameras/cam2/preview.mjpeg") as stream:
        assert stream.response.headers["Content-Type"] == "multipart/x-mixed-replace; boundary=throwcal"
        seen, pictures = [], set()

        def one_more():
            headers, data = stream.picture()
            assert jpeg_size(data) == (WIDTH_PX, HEIGHT_PX)
            pictures.add(data)
            seen.extend(balls_in(headers))
            return len(pictures) >= 10 and seen

        box.until(one_more, "ten pictures and a ball")
    assert all(-20 < u < WIDTH_PX + 20 and -20 < v < HEIGHT_PX + 20 for u, v in seen), seen
    print(f"{len(pictures)} different pictures, {len(seen)} balls ringed")


def who_never_reads_pictures_is_dropped(the_box) -> None:
    port = the_box.http_port
    with socket.socket() as deaf:
        deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        deaf.settimeout(box.PATIENCE_S)
        deaf.connect(("127.0.0.1", port))
        deaf.sendall(b"GET /api/v1/cameras/cam1/preview.mjpeg HTTP/1.1\r\nHost: box\r\n\r\n")
        connections = lambda: samples(get(port, "/metrics").body.decode())["throwcal_http_connections", None]
        box.until(lambda: connections() == 2, "it is there")
        box.until(lambda: connections() == 1, "it is dropped")


def a_session_told_by_events(the_box) -> None:
    """From start to calibration; each change is told, and what is asked for twice with a key is done once."""
    token = the_box.token
    with Stream(the_box.http_port, "/api/v1/events") as stream:
        assert stream.response.headers["Content-Type"] == "text/event-stream"
        name, first = stream.event()
        assert name == "status" and first["state"] == "idle" and first.keys() == status_of(the_box).keys(), first
        assert change(the_box, "stop", token).error() == (409, -32000)
        started = change(the_box, "start", token, {"Idempotency-Key": "start-1"}, b'{"until": "stopped"}')
        again = change(the_box, "start", token, body=b'{"until": "stopped", "key": "start-1"}')
        assert started.status == again.status == 200 and started.body == again.body, (started.body, again.body)
        assert change(the_box, "start", token).error() == (409, -32000)
        assert change(the_box, "stop", token, {"Idempotency-Key": "start-1"}).error() == (400, -32602)
        assert change(the_box, "start", token, {"Idempotency-Key": "a"}, b'{"key": "b"}').error() == (400, -32602)
        assert change(the_box, "start", token, {"Idempotency-Key": "k" * 65}).error() == (400, -32602)
        assert started.json()["session"] == 1

        def told(condition):
            return box.until(lambda: (s := stream.event()[1]) and condition(s) and s, "an event that tells it")

        told(lambda s: s["state"] in ("warming-up", "capturing"))
        told(lambda s: s["throws"] >= 4)
        assert change(the_box, "stop", token, {"Origin": f"http://127.0.0.1:{the_box.http_port}"}).status == 200
        done = told(lambda s: s["state"] == "done")
        assert done["session"] == 1, done


def a_calibration_is_the_same_bytes_for_everybody(the_box) -> None:
    port = the_box.http_port
    with box.Client(the_box.port) as client:
        latest = client.call("calibration.latest")
    for path in ("/api/v1/calibration/latest", f"/api/v1/calibration/{latest['id']}"):
        answer = get(port, path)
        digest = hashlib.sha256(answer.body)
        assert answer.json() == latest, path
        tag = answer.headers["ETag"]
        assert tag == f'"{digest.hexdigest()}"' and answer.headers["X-Content-SHA256"] == digest.hexdigest(), dict(answer.headers)
        assert answer.headers["Repr-Digest"] == f"sha-256=:{base64.b64encode(digest.digest()).decode()}:"
        assert get(port, path).body == answer.body
        head = ask(port, "HEAD", path)
        assert head.body == b"" and head.headers["ETag"] == tag and int(head.headers["Content-Length"]) == len(answer.body)
        for known in (tag, f'"x", W/{tag}', "*"):
            unchanged = get(port, path, {"If-None-Match": known})
            assert unchanged.status == 304 and unchanged.body == b"" and unchanged.headers["ETag"] == tag, known
        assert get(port, path, {"If-None-Match": '"x"'}).status == 200
    with socket.create_connection(("127.0.0.1", the_box.port)) as plain:  # what JSON-RPC sends holds the very same bytes
        plain.sendall(b'{"jsonrpc":"2.0","id":1,"method":"calibration.latest"}\n')
        lines = plain.makefile("rb")
        assert b'"hello"' in lines.readline()
        assert lines.readline() == b'{"jsonrpc":"2.0","id":1,"result":' + get(port, "/api/v1/calibration/latest").body + b"}\n"
    listed = get(port, "/api/v1/calibration").json()
    assert [c["id"] for c in listed] == [latest["id"]] and get(port, f"/api/v1/calibration/{latest['id'] + 1}").status == 404
    print(f"calibration {latest['id']}: {latest['verdict']}, {len(get(port, '/api/v1/calibration/latest').body)} bytes")


def metrics_are_what_the_status_says(the_box) -> None:
    first = samples(get(the_box.http_port, "/metrics").body.decode())
    status = status_of(the_box)
    second = samples(get(the_box.http_port, "/metrics").body.decode())
    assert first["throwcal_state", f'state="{status["state"]}"'] == 1 and first["throwcal_throws", None] == status["throws"]
    assert first["throwcal_worst_sigma_position_metres", None] == status["worst_sigma_position_m"]
    assert first["throwcal_fault", None] == 0
    for camera in status["cameras"]:
        label = f'camera="{camera["name"]}"'
        assert first["throwcal_camera_frames_total", label] <= camera["frames"] <= second["throwcal_camera_frames_total", label]
        assert first["throwcal_camera_running", label] == 1
    assert {key for key in first if key[0].endswith("_total")} == {key for key in second if key[0].endswith("_total")}
    assert all(second[key] >= first[key] for key in first if key[0].endswith("_total"))
    print(f"{len(first)} samples of metrics")


def the_support_bundle_is_whole_and_tells_no_secret(the_box, folder) -> None:
    answer = get(the_box.http_port, "/api/v1/support")
    assert answer.headers["Content-Disposition"] == 'attachment; filename="throwcal-support.tar"'
    assert the_box.token.encode() not in answer.body and b"token_file" not in answer.body
    with tarfile.open(fileobj=io.BytesIO(answer.body), mode="r:") as tar:
        files = {member.name.removeprefix("throwcal-support/"): tar.extractfile(member).read().decode() for member in tar}
        assert all(member.isreg() and member.mode == 0o644 for member in tar)
    assert set(files) == {
        "versions.txt",
        "status.json",
        "system.json",
        "cameras.json",
        "sessions.json",
        "calibrations.json",
        "calibration-latest.json",
        "rig.toml",
        "metrics.txt",
        "log.txt",
    }
    latest = get(the_box.http_port, "/api/v1/calibration/latest").json()
    assert json.loads(files["calibration-latest.json"]) == latest and json.loads(files["status.json"])["state"] == "done"
    assert samples(files["metrics.txt"]) and "session 1 began" in files["log.txt"] and '[[camera]]\nname = "cam1"' in files["rig.toml"]
    print(f"support bundle: {len(files)} files, {len(answer.body)} bytes")


def it_stops_cleanly_under_open_streams(the_box) -> None:
    port = the_box.http_port
    with Stream(port, "/api/v1/events") as events, Stream(port, "/api/v1/cameras/cam1/preview.mjpeg") as pictures:
        with socket.create_connection(("127.0.0.1", port)) as half:
            half.sendall(b"GET /api/v1/st")
            events.event(), pictures.picture()
            took = the_box.stop()
        for stream in (events, pictures):  # an answer that was cut would raise IncompleteRead
            stream.response.read()
    print(f"stopped in {took:.2f} s")


def losses(the_box) -> list[dict]:
    cameras = status_of(the_box)["cameras"]
    return [{key: camera[key] for key in ("frames_dropped", "frames_lost_by_driver", "frames_damaged")} for camera in cameras]


def http_can_be_off(build, folder) -> None:
    rig = (folder / "rig.toml").read_text()
    for text in ("off", ""):
        changed, count = re.subn(r'(\[http\]\nlisten = )"[^"]*"', rf'\1"{text}"', rig)
        assert count == 1
        (folder / "rig.toml").write_text(changed)
        with box.running_box(build, folder, http=[]) as the_box, box.Client(the_box.port) as client:
            assert the_box.http_port is None and client.call("status.get")["state"]
            assert ", HTTP" not in (folder / "log").read_text().splitlines()[-1]
            the_box.stop()


def story(build, folder) -> None:
    # Small pictures, so that a machine loaded with other work does not lose frames by itself.
    box.simulate(build, folder, "--cameras", "2", "--width", str(WIDTH_PX), "--height", str(HEIGHT_PX), "--focal", "240", "--fps", "30")
    with box.running_box(build, folder) as the_box:
        box.until(lambda: all(c["frames"] > 0 for c in status_of(the_box)["cameras"]), "every camera runs")
        before = losses(the_box)
        for attack in [every_route_answers, the_page_is_whole_and_reaches_nothing_else, each_fault_has_its_status, writes_without_the_token_are_refused,
                       bodies_have_limits, heads_have_limits, garbage_is_refused, what_is_half_open_is_closed_and_hinders_nobody,
                       one_connection_too_many_is_told_so, streams_leave_room_for_questions, many_come_and_go, pictures_come_with_the_ball_ringed,
                       who_never_reads_pictures_is_dropped, a_session_told_by_events, a_calibration_is_the_same_bytes_for_everybody,
                       metrics_are_what_the_status_says]:  # fmt: skip
            attack(the_box)
            lost = [sum(camera.values()) for camera in losses(the_box)]
            print(f"ok: {attack.__name__}; frames lost so far: {lost}", flush=True)
        the_support_bundle_is_whole_and_tells_no_secret(the_box, folder)
        after = losses(the_box)
        frames = [camera["frames"] for camera in status_of(the_box)["cameras"]]
        print(f"frames {frames}, lost {after}")
        assert after == before and all(frames), (before, after)
        it_stops_cleanly_under_open_streams(the_box)
        log = (folder / "log").read_text()
        assert log.count("more than 16 HTTP connections") == 1, f"each cause is told once:\n{log}"
    http_can_be_off(build, folder)


if __name__ == "__main__":
    box.main(story)
