#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""tcp_client.py BOX TOKEN [PORT]: captures throws until they suffice, and writes calibration.json."""
import json, socket, sys, time

box = socket.create_connection((sys.argv[1], int((sys.argv + [7710])[3]))).makefile("rwb")


def call(method, **params):
    box.write(json.dumps({"jsonrpc": "2.0", "id": method, "method": method, "params": params}).encode() + b"\n")
    box.flush()
    while (answer := json.loads(box.readline())).get("id") != method: pass  # `hello` and the like
    return answer["result"]


call("auth", token=sys.argv[2])
call("capture.start")
while call("status.get")["state"] != "done": time.sleep(0.5)
json.dump(call("calibration.latest"), open("calibration.json", "w"))
