#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""The TCP link against what a network sends: each fault has its answer, and no camera loses a frame because of it."""

import json
import pathlib
import re
import socket

import box

MAX_LINE_BYTES, MAX_CLIENTS = 64 * 1024, 16


def error_of(message) -> tuple:
    return message["id"], message["error"]["code"]


def garbage_is_answered_and_the_connection_goes_on(port) -> None:
    with box.Client(port) as client:
        client.line()
        for garbage, code in [
            (b"hello there\n", -32700),
            (b"\xff\xfe\x00\n", -32700),
            (b"GET / HTTP/1.1\r\n", -32700),
            (b"[]\n", -32600),
            (b"17\n", -32600),
            (b'{"jsonrpc":"2.0","id":null,"method":4}\n', -32600),
        ]:
            client.send(garbage)
            assert error_of(client.line()) == (None, code), garbage
        assert client.answer("no.such")["error"]["code"] == -32601
        assert client.answer("calibration.get", {"id": "one"})["error"]["code"] == -32602
        assert "state" in client.call("status.get")


def a_batch_and_a_notification(port) -> None:
    with box.Client(port) as client:
        client.line()
        requests = [
            {"jsonrpc": "2.0", "id": 1, "method": "camera.list"},
            {"jsonrpc": "2.0", "method": "status.get"},
            {"jsonrpc": "2.0", "id": "b", "method": "system.info"},
        ]
        client.send(json.dumps(requests).encode() + b"\r\n\n")
        cameras, info = client.line()
        assert [c["name"] for c in cameras["result"]] == ["cam1", "cam2"]
        assert info["id"] == "b" and info["result"]["software"].startswith("throwcal "), info


def an_oversize_line_is_refused_and_the_connection_closed(port) -> None:
    with box.Client(port) as client:
        client.line()
        client.send(b"x" * MAX_LINE_BYTES + b"\n")  # as long as may be: only not JSON
        assert error_of(client.line()) == (None, -32700)
        client.send(b"x" * (3 * MAX_LINE_BYTES))
        message = client.line()
        assert error_of(message) == (None, -32600) and str(MAX_LINE_BYTES) in message["error"]["message"], message
        assert client.line() is None


def half_a_request_is_dropped(port) -> None:
    with box.Client(port) as client:
        client.line()
        client.send(b'{"jsonrpc":"2.0","id":1,"met')
        client.socket.shutdown(socket.SHUT_WR)
        assert client.line() is None


def what_was_asked_before_hanging_up_is_answered(port) -> None:
    with box.Client(port) as client:
        client.line()
        client.send(b'{"jsonrpc":"2.0","id":5,"method":"hello"}\n')
        client.socket.shutdown(socket.SHUT_WR)
        assert client.line()["id"] == 5
        assert client.line() is None


def a_slow_reader_is_dropped(port) -> None:
    """It asks and asks and never reads: the box keeps a megabyte for it, no more."""
    with box.Client(port) as client:
        request = b'{"jsonrpc":"2.0","id":1,"method":"status.get"}\n' * 500
        client.socket.settimeout(10.0)  # a busy machine takes its time
        try:
            for _ in range(400):  # 200 000 answers: over 100 MB
                client.send(request)
        except OSError:  # reset, or, with both buffers full, nothing is taken any more
            pass
        else:
            raise AssertionError("the box took 200 000 requests of a client that never reads")


def a_slow_subscriber_gets_the_newest_status_not_all(port) -> None:
    with box.Client(port) as client:
        client.line()
        uptime = client.call("status.subscribe")["uptime_s"]
        notices = [client.line() for _ in range(3)]
        assert all(n["method"] == "status" for n in notices)
        uptimes = [uptime, *(n["params"]["uptime_s"] for n in notices)]
        assert uptimes == sorted(uptimes) and uptimes[-1] > uptimes[0], uptimes


def one_client_too_many_is_told_so(port) -> None:
    clients = [box.Client(port) for _ in range(20)]
    first = [client.line() for client in clients]
    served = [m for m in first if m.get("method") == "hello"]
    refused = [m for m in first if "error" in m]
    assert len(served) == MAX_CLIENTS and len(refused) == 20 - MAX_CLIENTS, first
    assert all(error_of(m) == (None, -32000) and "16 clients" in m["error"]["message"] for m in refused), refused
    assert all(c.line() is None for c, m in zip(clients, first) if "error" in m)
    for client in clients:
        client.__exit__()

    def all_places_are_free():
        with box.Client(port) as client:
            return client.line().get("method") == "hello" and client.call("system.info")["clients"] == 1

    box.until(all_places_are_free, "all places are free again")


def what_changes_something_is_refused_without_the_token(port) -> None:
    source = pathlib.Path(__file__).parent.parent.parent / "firmware" / "rpc_methods.cpp"
    changing = re.findall(r'add_change\(\s*"([a-z.]+)"', source.read_text())
    assert {"capture.start", "capture.stop", "capture.abort", "session.delete"} <= set(changing), changing
    with box.Client(port) as client:
        client.line()
        before = client.call("status.get")["session"], client.call("session.list")
        for method in changing:
            for params in ({}, {"session": 1}, {"key": "abc"}, {"token": "guess"}):
                assert client.answer(method, params)["error"]["code"] == -32001, method
        assert client.answer("auth", {"token": "not-the-token"})["error"]["code"] == -32001
        assert client.answer("capture.start")["error"]["code"] == -32001
        assert (client.call("status.get")["session"], client.call("session.list")) == before


def cameras_of(port) -> list[dict]:
    with box.Client(port) as client:
        client.line()
        return client.call("status.get")["cameras"]


def story(build, folder) -> None:
    # Small pictures, so that a machine loaded with other work does not lose frames by itself.
    box.simulate(build, folder, "--cameras", "2", "--width", "320", "--height", "240", "--focal", "240", "--fps", "30")
    with box.running_box(build, folder) as the_box:
        box.until(lambda: all(c["frames"] > 0 for c in cameras_of(the_box.port)), "every camera runs")
        before = cameras_of(the_box.port)
        for attack in [
            what_changes_something_is_refused_without_the_token,
            garbage_is_answered_and_the_connection_goes_on,
            a_batch_and_a_notification,
            an_oversize_line_is_refused_and_the_connection_closed,
            half_a_request_is_dropped,
            what_was_asked_before_hanging_up_is_answered,
            a_slow_reader_is_dropped,
            a_slow_subscriber_gets_the_newest_status_not_all,
            one_client_too_many_is_told_so,
        ]:
            attack(the_box.port)
            print("ok:", attack.__name__)
        after = cameras_of(the_box.port)
        for was, now in zip(before, after):
            assert now["running"] and now["frames"] > was["frames"], (was, now)
            lost = {key: now[key] - was[key] for key in ("frames_dropped", "frames_lost_by_driver")}
            print(f"{now['name']}: {now['frames'] - was['frames']} frames, {lost}")
            assert not any(lost.values()), (was, now)
        the_box.stop()
        log = (folder / "log").read_text()
        for cause in ("in the middle of a request", "oversize line", "does not read", "more than 16 clients"):
            assert log.count(cause) == 1, f"{cause!r} must be told once:\n{log}"


if __name__ == "__main__":
    box.main(story)
