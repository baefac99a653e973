#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Sessions over HTTP: listed, shown, fetched whole or not at all, however large, and deleted by those who may."""

import base64
import contextlib
import hashlib
import http.client
import re
import socket
import sqlite3

import box
from http_talk import Answer, ask, change, get, status_of

MAX_STREAMS = 12
LARGE_BYTES = 150_000_000


def delete(the_box, session, token: str | None = None, headers: dict | None = None, body: bytes | None = None) -> Answer:
    bearer = {"Authorization": f"Bearer {token}"} if token is not None else {}
    return ask(the_box.http_port, "DELETE", f"/api/v1/sessions/{session}", {**bearer, **(headers or {})}, body)


def file_of(the_box, session: int):
    return the_box.folder / "state" / "sessions" / f"{session:06d}.throwcal"


def captured(the_box) -> int:
    """A session of one throw; its number. What is refused while it is under way."""
    session = change(the_box, "start", the_box.token, body=b'{"until": "stopped"}').json()["session"]
    assert get(the_box.http_port, f"/api/v1/sessions/{session}").json()["state"] == "capturing"
    assert get(the_box.http_port, f"/api/v1/sessions/{session}/file").error() == (409, -32000)
    assert delete(the_box, session, the_box.token).error() == (409, -32000)
    box.until(lambda: status_of(the_box)["throws"] >= 1, "a throw found")
    assert get(the_box.http_port, f"/api/v1/sessions/{session}/file").error() == (409, -32000)
    change(the_box, "stop", the_box.token)
    box.until(lambda: status_of(the_box)["state"] == "done", "the session is solved")
    return session


def where_there_is_none_it_says_so(the_box) -> None:
    port = the_box.http_port
    assert get(port, "/api/v1/sessions").json() == []
    for path, expected in [("1", (404, -32000)), ("1/file", (404, -32000)), ("0", (404, -32000)), ("-1/file", (404, -32000)), ("one", (400, -32602)),
                           ("one/file", (400, -32602)), ("99999999999999999999/file", (400, -32602)), ("9223372036854775807/file", (404, -32000)),
                           ("1/files", (404, -32601)), ("%2e%2e/file", (400, -32602)), ("1.0", (400, -32602))]:  # fmt: skip
        assert get(port, "/api/v1/sessions/" + path).error() == expected, (path, get(port, "/api/v1/sessions/" + path).error())
    for method, path, allowed in [("POST", "1", "GET, HEAD, DELETE"), ("DELETE", "1/file", "GET, HEAD"), ("PUT", "", "GET, HEAD")]:
        answer = ask(port, method, f"/api/v1/sessions/{path}".rstrip("/"))
        assert answer.error()[0] == 405 and answer.headers["Allow"] == allowed, (method, path, dict(answer.headers))


def known_to_its_tag(port, path: str, answer: Answer) -> None:
    """That an answer has what lets a client check and keep it."""
    digest = hashlib.sha256(answer.body)
    tag = answer.headers["ETag"]
    assert tag == f'"{digest.hexdigest()}"' and answer.headers["X-Content-SHA256"] == digest.hexdigest(), dict(answer.headers)
    assert answer.headers["Repr-Digest"] == f"sha-256=:{base64.b64encode(digest.digest()).decode()}:"
    assert answer.headers["Cache-Control"] == "no-cache" and int(answer.headers["Content-Length"]) == len(answer.body)
    unchanged = get(port, path, {"If-None-Match": tag})
    assert unchanged.status == 304 and unchanged.body == b"" and unchanged.headers["ETag"] == tag
    head = ask(port, "HEAD", path)
    assert head.status == 200 and not head.body and head.headers["ETag"] == tag and int(head.headers["Content-Length"]) == len(answer.body)


def they_are_listed_and_shown(the_box, session: int) -> None:
    port = the_box.http_port
    with box.Client(the_box.port) as client:
        listed, shown = client.call("session.list"), client.call("session.get", {"session": session})
    for path, expected in [("/api/v1/sessions", listed), (f"/api/v1/sessions/{session}", shown)]:
        answer = get(port, path)
        assert answer.status == 200 and answer.json() == expected, path
        known_to_its_tag(port, path, answer)


def a_file_is_fetched(the_box, session: int) -> None:
    path = f"/api/v1/sessions/{session}/file"
    answer = get(the_box.http_port, path)
    assert answer.status == 200 and answer.body == file_of(the_box, session).read_bytes()
    assert answer.headers["Content-Disposition"] == f'attachment; filename="{session:06d}.throwcal"', dict(answer.headers)
    assert answer.headers["Content-Type"] == "application/vnd.sqlite3" and answer.headers["X-Content-Type-Options"] == "nosniff"
    known_to_its_tag(the_box.http_port, path, answer)
    fetched = the_box.folder / "fetched.throwcal"
    fetched.write_bytes(answer.body)
    with contextlib.closing(sqlite3.connect(fetched)) as database:
        assert database.execute("PRAGMA integrity_check").fetchall() == [("ok",)]
        assert database.execute("SELECT id, state FROM session").fetchall() == [(session, "done")]
    print(f"session {session}: {len(answer.body)} bytes")


def a_file_whose_last_writes_lie_beside_it_is_refused(the_box, session: int) -> None:
    file = file_of(the_box, session)
    for beside in ("-wal", "-journal"):
        log = file.with_name(file.name + beside)
        log.write_bytes(b"x")
        assert get(the_box.http_port, f"/api/v1/sessions/{session}/file").error() == (409, -32000)
        log.unlink()
    assert get(the_box.http_port, f"/api/v1/sessions/{session}/file").status == 200


def only_who_may_deletes(the_box, session: int) -> None:
    token = the_box.token
    for headers in [{}, {"Authorization": "Bearer "}, {"Authorization": f"Bearer {token}0"}, {"Authorization": f"Basic {token}"}, {"X-Token": token}]:
        answer = delete(the_box, session, headers=headers)
        assert answer.error() == (401, -32001) and answer.headers["WWW-Authenticate"].startswith("Bearer "), headers
    assert delete(the_box, session, token, {"Origin": "http://elsewhere"}).error() == (403, -32001)
    assert delete(the_box, session, token, body=b"[]").error() == (400, -32700)
    assert delete(the_box, session, token, body=b'{"session": 999}').error() == (400, -32602)
    for other, expected in [(999, (404, -32000)), (-1, (404, -32000)), ("one", (400, -32602)), (2**63, (400, -32602))]:
        assert delete(the_box, other, token).error() == expected, other
    assert file_of(the_box, session).exists()
    deleted = delete(the_box, session, token, {"Idempotency-Key": "d1", "Origin": f"http://127.0.0.1:{the_box.http_port}"})
    assert deleted.status == 200 and deleted.json() == {"deleted": session}, deleted.body
    assert not file_of(the_box, session).exists()
    assert delete(the_box, session, token, {"Idempotency-Key": "d1"}).body == deleted.body, "asked again with its key"
    assert delete(the_box, session, token).error() == (404, -32000)
    assert get(the_box.http_port, f"/api/v1/sessions/{session}").error() == (404, -32000)
    assert session not in [s["session"] for s in get(the_box.http_port, "/api/v1/sessions").json()]


def enlarged(file) -> None:
    """A session with pictures of so many bytes that they are in no memory."""
    with contextlib.closing(sqlite3.connect(file)) as database:
        before = file.stat().st_size
        for number in range((LARGE_BYTES - before) // 1_000_000 + 1):
            database.execute("INSERT INTO evidence VALUES(NULL, 0, ?, 0, 0, 0, 1000, 1000, 1, randomblob(1000000))", (number,))
            database.commit()
    assert file.stat().st_size >= LARGE_BYTES


def most_memory(the_box) -> int:
    return 1024 * int(re.search(r"VmHWM:\s+(\d+) kB", open(f"/proc/{the_box.process.pid}/status").read())[1])


def begun(port, path: str) -> tuple[http.client.HTTPConnection, http.client.HTTPResponse]:
    """An answer of which only the head was read."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=box.PATIENCE_S)
    connection.request("GET", path)
    return connection, connection.getresponse()


def a_large_file_takes_no_memory_and_hinders_nobody(the_box, session: int) -> None:
    port, path = the_box.http_port, f"/api/v1/sessions/{session}/file"
    get(port, path.removesuffix("/file"))
    before = most_memory(the_box)
    downloads = [begun(port, path) for _ in range(MAX_STREAMS)]
    assert [response.status for _, response in downloads] == [200] * MAX_STREAMS
    assert get(port, path).error() == get(port, "/api/v1/events").error() == (503, -32000), "their places are taken"
    assert status_of(the_box)["state"] == "idle"
    for connection, _ in downloads[1:]:
        connection.close()
    connection, response = downloads[0]
    digest, size = hashlib.sha256(), 0
    while piece := response.read(1_000_000):
        digest.update(piece)
        size += len(piece)
    connection.close()
    assert size == file_of(the_box, session).stat().st_size and digest.hexdigest() == response.headers["X-Content-SHA256"]
    grown = most_memory(the_box) - before
    print(f"{size / 1e6:.0f} MB fetched, twelve at once; the box's memory grew by {grown / 1e6:.1f} MB at most")
    assert grown < 30e6
    box.until(lambda: get(port, path, {"If-None-Match": response.headers["ETag"]}).status == 304, "the others' places are free")


def who_leaves_before_the_digest_is_known_leaves_nothing(the_box, session: int) -> None:
    port, file = the_box.http_port, file_of(the_box, session)
    file.touch()  # so that its digest must be found again
    request = f"GET /api/v1/sessions/{session}/file HTTP/1.1\r\nHost: box\r\n\r\n".encode()
    for _ in range(MAX_STREAMS):
        with socket.create_connection(("127.0.0.1", port), timeout=box.PATIENCE_S) as gone:
            gone.sendall(request)
    box.until(lambda: get(port, "/metrics").body.count(b"\nthrowcal_http_connections 1\n") == 1, "all who left are gone")
    assert get(port, f"/api/v1/sessions/{session}/file", {"If-None-Match": "*"}).status == 304


def what_is_written_to_meanwhile_is_cut_off(the_box, session: int) -> None:
    connection, response = begun(the_box.http_port, f"/api/v1/sessions/{session}/file")
    first = response.read(1_000_000)
    with file_of(the_box, session).open("ab") as file:
        file.write(b"more")
    try:
        response.read()
    except http.client.IncompleteRead as cut:
        print(f"cut off after {len(first + cut.partial)} of {response.headers['Content-Length']} bytes")
    else:
        raise AssertionError("a file of two halves passed for one")
    connection.close()


def what_is_deleted_meanwhile_still_comes_whole(the_box, session: int) -> None:
    connection, response = begun(the_box.http_port, f"/api/v1/sessions/{session}/file")
    assert delete(the_box, session, the_box.token).status == 200
    assert hashlib.sha256(response.read()).hexdigest() == response.headers["X-Content-SHA256"]
    connection.close()


def it_stops_cleanly_in_the_middle_of_a_file(the_box, session: int) -> None:
    connection, response = begun(the_box.http_port, f"/api/v1/sessions/{session}/file")
    file_of(the_box, session).touch()
    with socket.create_connection(("127.0.0.1", the_box.http_port)) as waits_for_a_digest:
        waits_for_a_digest.sendall(f"GET /api/v1/sessions/{session}/file HTTP/1.1\r\nHost: box\r\n\r\n".encode())
        the_box.stop()
    connection.close()


def story(build, folder) -> None:
    box.simulate(build, folder, "--cameras", "2", "--width", "320", "--height", "240", "--focal", "240", "--fps", "30")
    with box.running_box(build, folder) as the_box:
        where_there_is_none_it_says_so(the_box)
        large, small = captured(the_box), captured(the_box)
        for attack in [they_are_listed_and_shown, a_file_is_fetched, a_file_whose_last_writes_lie_beside_it_is_refused, only_who_may_deletes]:
            attack(the_box, small)
            print(f"ok: {attack.__name__}", flush=True)
        the_box.stop()
    enlarged(file_of(the_box, large))
    with box.running_box(build, folder) as the_box:
        for attack in [a_large_file_takes_no_memory_and_hinders_nobody, who_leaves_before_the_digest_is_known_leaves_nothing,
                       what_is_written_to_meanwhile_is_cut_off, what_is_deleted_meanwhile_still_comes_whole]:  # fmt: skip
            attack(the_box, large)
            print(f"ok: {attack.__name__}", flush=True)
        it_stops_cleanly_in_the_middle_of_a_file(the_box, captured(the_box))


if __name__ == "__main__":
    box.main(story)
