# SPDX-License-Identifier: BSD-3-Clause
"""Another client of a box on CAN than ours, of the standard library alone: `document` (over ISO-TP, beside the bytes that TCP gives)
and `commands`, each with its answer."""

import hashlib
import json
import pathlib
import socket
import struct
import sys
import time
import zlib

BASE = 0x680
COMMAND, ACK, RESULT, DOCUMENT, FLOW = (BASE + offset for offset in range(3, 8))
START, STOP, BLOCK = 1, 2, 4
OUTCOMES = ("ok", "refused", "forbidden", "unknown", "malformed", "locked", "busy", "unsupported")
PATIENCE_S = 60


class Bus:
    def __init__(self, interface: str):
        self.raw = socket.socket(socket.PF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        self.raw.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, struct.pack("=II", ACK, 0x7FF))
        self.raw.settimeout(PATIENCE_S)
        self.raw.bind((interface,))
        self.long = socket.socket(socket.PF_CAN, socket.SOCK_DGRAM, socket.CAN_ISOTP)
        self.long.settimeout(PATIENCE_S)
        self.long.bind((interface, DOCUMENT, FLOW))

    def send(self, data: bytes) -> dict:
        """The answer to a command."""
        self.raw.send(struct.pack("=IB3x8s", COMMAND, len(data), data))
        _, order, sequence, outcome, state, session = struct.unpack("=8sBBBBI", self.raw.recv(16))
        return {"order": order, "sequence": sequence, "outcome": OUTCOMES[outcome], "state": state, "session": session}

    def command(self, order: int, sequence: int, key: int = 0, argument: int = 0) -> dict:
        return self.send(struct.pack("<BBHI", order, sequence, argument, key))

    def block(self, number: int) -> tuple:
        """What its header says, and its text."""
        while (answer := self.command(BLOCK, number, 0, number))["outcome"] == "busy":
            time.sleep(0.05)
        assert answer["outcome"] == "ok", answer
        block = self.long.recv(8192)
        version, sequence, this, blocks, _, length, crc32 = struct.unpack("<BBHHHII", block[:16])
        assert version == 1 and this == number and len(block) <= 4000, (version, this, len(block))
        return (sequence, blocks, length, crc32), block[16:]

    def document(self) -> bytes:
        head, text = self.block(0)
        return self.rest(head, text)

    def rest(self, head: tuple, text: bytes) -> bytes:
        for number in range(1, head[1]):
            its_head, piece = self.block(number)
            assert its_head == head, (its_head, head)
            text += piece
        assert len(text) == head[2] and zlib.crc32(text) == head[3], (len(text), head)
        return text


def await_another_result(interface: str, sequence: int) -> None:
    with socket.socket(socket.PF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as results:
        results.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, struct.pack("=II", RESULT, 0x7FF))
        results.settimeout(PATIENCE_S)
        results.bind((interface,))
        while results.recv(16)[8] == sequence:
            pass


def over_tcp(port: int) -> bytes:
    """The bytes of calibration.latest's result."""
    with socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S) as connection, connection.makefile("rb") as lines:
        connection.sendall(b'{"jsonrpc":"2.0","id":7,"method":"calibration.latest"}\n')
        for line in lines:
            head, found, rest = line.partition(b'"id":7,"result":')
            if found:
                return rest.rstrip(b"\n")[:-1]
    raise AssertionError("no answer on TCP")


def delete_over_tcp(port: int, token: str, session: int) -> None:
    requests = [("auth", {"token": token}), ("session.delete", {"session": session})]
    with socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S) as connection, connection.makefile("rb") as lines:
        for method, params in requests:
            connection.sendall(json.dumps({"jsonrpc": "2.0", "id": method, "method": method, "params": params}).encode() + b"\n")
            while (answer := json.loads(lines.readline())).get("id") != method:
                pass
            assert "result" in answer, answer


def commands(bus: Bus, interface: str, token: str, port: int) -> dict:
    """Each by a name; the state machine is the box's own. A document that was begun goes on as it was though its session is deleted."""
    key = int.from_bytes(hashlib.sha256(token.encode()).digest()[:4], "big")
    was = over_tcp(port)
    head, begun = bus.block(0)
    answers = {
        "no key": bus.command(START, 1),
        "a wrong key": bus.command(START, 2, key ^ 1),
        "nothing": bus.command(0, 3, key),
        "seven bytes": bus.send(struct.pack("<BBHI", START, 4, 0, key)[:7]),
        "a block too many": bus.command(BLOCK, 5, 0, 9999),
        "start": bus.command(START, 6, key),
        "the same start": bus.command(START, 6, key),
        "another start": bus.command(START, 7, key),
        "stop": bus.command(STOP, 8, key),
    }
    answers |= {f"wrong {n}": bus.command(START, 10 + n, 12345) for n in range(5)}
    answers |= {"right, but locked": bus.command(START, 20, key)}
    delete_over_tcp(port, token, json.loads(was)["session"])
    await_another_result(interface, head[0])
    answers["a document begun before"] = {"same": bus.rest(head, begun) == was, "bytes": len(was), "newest_bytes": len(bus.document())}
    return answers


def main() -> None:
    what, interface, port, token_file, out = sys.argv[1:]
    bus = Bus(interface)
    if what == "document":
        over_can, tcp = bus.document(), over_tcp(int(port))
        pathlib.Path(out).write_text(json.dumps({"bytes": len(tcp), "same": over_can == tcp}))
    else:
        token = pathlib.Path(token_file).read_text().strip()
        pathlib.Path(out).write_text(json.dumps(commands(bus, interface, token, int(port))))


if __name__ == "__main__":
    main()
