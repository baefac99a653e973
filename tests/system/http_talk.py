# SPDX-License-Identifier: BSD-3-Clause
"""Whoever talks HTTP to a box: requests, raw bytes, streams."""

import http.client
import json
import re
import socket

import box


class Answer:
    def __init__(self, response: http.client.HTTPResponse):
        self.status, self.headers, self.body = response.status, response.headers, response.read()

    def json(self):
        assert self.headers["Content-Type"] == "application/json", dict(self.headers)
        return json.loads(self.body)

    def error(self) -> tuple[int, int]:
        """Status, and JSON-RPC's code; every fault has both."""
        fault = self.json()["error"]
        assert set(fault) == {"code", "message"} and fault["message"], fault
        return self.status, fault["code"]


def ask(port, method: str, path: str, headers: dict | None = None, body: bytes | None = None) -> Answer:
    """A connection of its own."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=box.PATIENCE_S)
    try:
        connection.request(method, path, body=body, headers=headers or {})
        return Answer(connection.getresponse())
    finally:
        connection.close()


def get(port, path: str, headers: dict | None = None) -> Answer:
    return ask(port, "GET", path, headers)


def status_of(the_box) -> dict:
    return get(the_box.http_port, "/api/v1/status").json()


def change(the_box, what: str, token: str | None = None, headers: dict | None = None, body: bytes | None = None) -> Answer:
    bearer = {"Authorization": f"Bearer {token}"} if token is not None else {}
    return ask(the_box.http_port, "POST", f"/api/v1/capture/{what}", {**bearer, **(headers or {})}, body)


def raw(port, data: bytes) -> bytes:
    """What comes back until the box closes or has answered with a whole head and its short body."""
    with socket.create_connection(("127.0.0.1", port), timeout=box.PATIENCE_S) as connection:
        connection.sendall(data)
        answer = b""
        while piece := connection.recv(65536):
            answer += piece
            if (head := re.match(rb"(?s)HTTP/1.1 \d+.*?Content-Length: (\d+).*?\r\n\r\n", answer)) and len(answer) >= head.end() + int(head[1]):
                break
        return answer


class Stream:
    """An answer that does not end."""

    def __init__(self, port, path: str):
        self.connection = http.client.HTTPConnection("127.0.0.1", port, timeout=box.PATIENCE_S)
        self.connection.request("GET", path)
        self.response = self.connection.getresponse()

    def __enter__(self):
        assert self.response.status == 200, self.response.read()
        return self

    def __exit__(self, *_):
        self.connection.close()

    def line(self) -> str:
        return self.response.readline().decode().rstrip("\r\n")

    def event(self) -> tuple[str, dict]:
        """The next event's name and document."""
        fields = {}
        while line := self.line():
            name, _, value = line.partition(": ")
            fields[name] = value
        return fields.get("event", ""), json.loads(fields["data"]) if "data" in fields else {}

    def picture(self) -> tuple[dict, bytes]:
        """The next part's headers and JPEG."""
        while (line := self.line()) != "--throwcal":
            assert line == "", line
        headers = {}
        while line := self.line():
            name, _, value = line.partition(": ")
            headers[name] = value
        assert headers["Content-Type"] == "image/jpeg", headers
        return headers, self.response.read(int(headers["Content-Length"]))
