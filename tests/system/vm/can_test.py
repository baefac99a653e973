#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""The box on CAN, with the kernel's own buses: every message by throwcal.dbc beside the JSON, the document over ISO-TP byte for byte,
commands, and a bus that is missing, down, full, off, gone and another one. THROWCAL_LONG=1: both kernels."""

import collections
import json
import math
import os
import pathlib
import re
import signal
import subprocess
import sys
import tarfile
import tempfile
import venv

import vm

sys.path.insert(0, str(vm.HERE.parent))
import box as boxes  # noqa: E402

KERNELS = (12, 13) if os.environ.get("THROWCAL_LONG") else (12,)
CAMERAS, RUNNING = 8, 2  # of which so many run in the guest
BITS_PER_S = 250e3
BASE = 0x680
PERIODIC = {BASE + offset for offset in (0, 1, 2, 5, *range(8, 32))}

PRELUDE = """
set -e
tar xf state.tar -C /run
tar xf packages.tar -C /run
export THROWCAL_TOKEN=$(cat /run/state/token)
fetch() { ./throwcal fetch "$@" > out/fetched 2>&1 || [ $? = 3 ]; } # whatever its verdict
start_box() { # RIG: a box, and a connection to it
  rm -f /run/port
  ./throwcald --config $1 --listen 127.0.0.1:0 --port-file /run/port --state-dir /run/state 2>> out/log &
  box=$!
  while [ ! -s /run/port ]; do kill -0 $box; sleep 0.05; done
  host=127.0.0.1:$(cat /run/port)
  exec 8<> /dev/tcp/127.0.0.1/$(cat /run/port)
  read -r hello <&8
}
stop_box() { exec 8>&-; kill $box; wait $box; }
ask() { echo '{"jsonrpc":"2.0","id":1,"method":"status.get"}' >&8; read -r reply <&8; }
await() { # PATTERN of the status
  echo "awaits $1"
  until ask && [[ $reply =~ $1 ]]; do kill -0 $box; sleep 0.05; done
}
number() { [[ $reply =~ \\"$1\\":([0-9.]+) ]] && echo "${BASH_REMATCH[1]}"; }
"""

SCRIPT = """
modprobe -a vcan vxcan can-raw can-isotp
start_box rig.toml
await '"can":.*"state":"missing"'
ip link add dev can0 type vcan
await '"can":.*"state":"down"'
./throwcal status --can can0 > out/down 2>&1 || echo $? >> out/down
ip link set can0 up
await '"can":.*"state":"up"'
await '"result":."state":"done"'
candump -L can0 > out/candump &
recorder=$!
echo "$reply" > out/before
date +%s.%N > out/begin
./throwcal status --can can0 --json > out/status.json
./throwcal --can can0 status > out/status
./throwcal status --can can0 --unit 7 > out/unit7 2>&1 || echo $? >> out/unit7
cansend can0 683#0463000000000000 # who asks for a document and does not take it
await '"transfers_failed":1'
fetch --can can0 --output out/can.json
fetch --host $host --output out/tcp.json
python3 can_talk.py document can0 $(cat /run/port) /run/state/token out/document
PYTHONPATH=/run/packages python3 can_client.py > out/client
ask
echo "$reply" > out/after
date +%s.%N > out/end

python3 can_talk.py commands can0 $(cat /run/port) /run/state/token out/commands
until ./throwcal capture start --can can0 > out/start 2> out/locked; do kill -0 $box; sleep 0.2; done # the lock ends
./throwcal capture abort --can can0 > out/abort
./throwcal capture start --can can0 > out/start
await '"state":"(warming-up|capturing)"'
./throwcal capture stop --can can0 > out/stop
ask
echo "$reply" > out/stopped
./throwcal capture start --can can0 --token wrong-token > out/wrong 2>&1 || echo $? >> out/wrong
kill $recorder

cansend can0 20000004#0020000000000000 # the controller says: error-passive
await '"state":"error-passive"'
cansend can0 20000004#0040000000000000
await '"can":.*"state":"up".*"error_passive":1'
cansend can0 20000040#0000000000000000 # bus-off
await '"can":.*"bus_off":1'
await '"can":.*"state":"up".*"reopened":1'

tc qdisc add dev can0 root tbf rate 8bit burst 100 limit 100 # a bus that nothing goes through
await '"state":"queue-full"'
for n in 1 2; do
  await '"queue_full":[0-9]*'
  echo "$(number frames_lost) $(number uptime_s) $(cut -d' ' -f14 /proc/$box/stat)" >> out/full
  target=$(($(number frames_lost) + 40))
  until ask && [ $(number frames_lost) -ge $target ]; do kill -0 $box; sleep 0.05; done
done
ask
echo "$(number frames_lost) $(number uptime_s) $(cut -d' ' -f14 /proc/$box/stat)" >> out/full
tc qdisc del dev can0 root
await '"can":.*"state":"up"'

ip link set can0 down
await '"can":.*"state":"down"'
ip link set can0 up
await '"can":.*"state":"up".*"reopened":2'
ip link del can0
await '"can":.*"state":"missing"'
ip link add dev can0 type vcan
ip link set can0 up
await '"can":.*"state":"up".*"reopened":3'
candump -n 30 -L can0 > out/again
ip link add dev can8 type vxcan peer name can9 # no carrier as long as the peer is down
ip link del can0
await '"can":.*"state":"missing"'
ip link set can8 name can0
ip link set can0 up
await '"can":.*"state":"bus-off".*"bus_off":2'
ip link set can9 up
await '"can":.*"state":"up".*"reopened":4'
./throwcal status --can can9 > out/across # by the other end
echo "$reply" > out/last
stop_box

ip link add dev fd0 type vcan
ip link set fd0 mtu 16
ip link set fd0 up
rm -r /run/state # what was deleted above is there again
tar xf state.tar -C /run
start_box fd.toml
await '"can":.*"state":"unusable"'
ip link set fd0 down
ip link set fd0 mtu 72 # what carries CAN FD
ip link set fd0 up
await '"can":.*"state":"up"'
candump -L fd0 > out/candump.fd &
recorder=$!
await '"result":."state":"done"'
fetch --can fd0 --unit 3 --output out/fd.json
fetch --host $host --output out/fd.tcp.json
kill $recorder
stop_box
"""

CARDS = """
modprobe -a kvaser_pci can-raw
echo /bin/false > /proc/sys/kernel/modprobe # no can-isotp
for card in can0 can1; do ip link set $card type can bitrate 500000 restart-ms 100; done
ip link set can0 txqueuelen 1
start_box rig.toml
await '"can":.*"state":"down"'
ip link set can0 up
ip link set can1 up
await '"can":.*"state":"up"'
await '"result":."state":"done"'
await '"isotp_problem":"this kernel has no ISO-TP .module can-isotp."'
./throwcal fetch --can can1 > out/no_isotp 2>&1 || echo $? >> out/no_isotp
candump -n 1 -L can1,684:7FF > out/unsupported &
answer=$!
until ! kill -0 $answer 2> /dev/null; do cansend can1 683#0463000000000000; sleep 0.05; done
echo /sbin/modprobe > /proc/sys/kernel/modprobe
modprobe can-isotp
fetch --host $host --output out/tcp.json
fetch --can can1 --output out/can.json
cangen can0 -g 0 -I 100 -L 8 -i & # fills the queue of one place, from the same machine
flood=$!
for n in $(seq 100); do ask; sleep 0.02; done
kill $flood
echo "$reply" > out/flooded
ip link set can0 down
await '"can":.*"state":"down"'
ip link set can0 up
await '"can":.*"state":"up".*"reopened":1'
./throwcal status --can can1 > out/across
ask
echo "$reply" > out/last
stop_box
"""


def need_packages(build: pathlib.Path) -> pathlib.Path:
    """The folder of cantools and python-can, in a venv of the build folder."""
    home = build / "can_python"
    if not list(home.glob("lib/python*/site-packages/cantools")):
        try:
            venv.create(home, with_pip=True, clear=True)
            subprocess.run([home / "bin" / "pip", "install", "-q", "cantools", "python-can"], check=True, capture_output=True, text=True)
        except (OSError, subprocess.CalledProcessError) as error:
            vm.skip(f"needs cantools and python-can, which pip does not get: {getattr(error, 'stderr', error)}")
    return next(home.glob("lib/python*/site-packages"))


def packed(folder: pathlib.Path, name: str, out: pathlib.Path) -> pathlib.Path:
    with tarfile.open(out, "w") as archive:
        archive.add(folder, name, filter=lambda entry: None if re.search(r"/(pip|setuptools|__pycache__)\b", entry.name) else entry)
    return out


def make_state(build: pathlib.Path, folder: pathlib.Path) -> str:
    """A box of eight cameras with a short session, switched off in the middle of another: it solves what it has of that at its next start.
    Returns its rig file."""
    boxes.simulate(build, folder, "--cameras", str(CAMERAS), "--width", "320", "--height", "240", "--focal", "240", "--fps", "30")
    with boxes.running_box(build, folder) as box, boxes.Client(box.port) as client:
        client.line()
        client.may_change(box.token).call("capture.start", {"until": "stopped"})
        boxes.until(lambda: client.call("status.get")["calibration"], "a calibration")
        client.call("capture.stop")
        boxes.until(lambda: client.call("status.get")["state"] == "done", "the short session is solved")
        client.call("capture.start", {"until": "stopped"})
        boxes.until(lambda: client.call("status.get")["throws"] >= 3, "three throws")
        boxes.until(lambda: client.call("status.get")["worst_sigma_position_m"], "a calibration")
        box.process.send_signal(signal.SIGKILL)
        box.process.wait()
    return (folder / "rig.toml").read_text()


def guests_rig(rig: str, interface: str, unit: int, fd: bool) -> str:
    """The guest is too slow to draw for eight cameras: two are, at ten pictures a second; the others are not plugged in."""
    rig = re.sub(r"(?m)^frames_per_s = .*", "frames_per_s = 10", rig)
    for n in range(RUNNING, CAMERAS):
        head, name, tail = rig.partition(f'name = "cam{n + 1}"')
        rig = head + name + tail.replace('source = "simulated"', f'source = "v4l2:/dev/v4l/by-path/none{n}"', 1)
    return rig + f'\n[can]\ninterface = "{interface}"\nunit = {unit}\nfd = {str(fd).lower()}\n'


Frame = collections.namedtuple("Frame", "time_s id fd data")


def frames_of(text: str) -> list[Frame]:
    """Of `candump -L`: (time) interface ID#DATA, or of a CAN FD frame ID##FLAGS DATA."""
    out = []
    for line in text.splitlines():
        stamp, _, frame = line.split()[:3]
        name, _, data = frame.partition("#")
        fd = data.startswith("#")
        out.append(Frame(float(stamp.strip("()")), int(name, 16), fd, bytes.fromhex(data[2:] if fd else data)))
    return out


def bits_on_the_wire(frame: Frame) -> int:
    """A classic frame's, its stuff bits and the three bits after it included (ISO 11898-1)."""
    number = lambda value, count: [value >> n & 1 for n in reversed(range(count))]
    bits = [0, *number(frame.id, 11), 0, 0, 0, *number(len(frame.data), 4)]
    for byte in frame.data:
        bits += number(byte, 8)
    crc = 0
    for bit in bits:
        crc = (crc << 1 ^ (0x4599 if bit ^ crc >> 14 & 1 else 0)) & 0x7FFF
    stuffed, last, run = 0, None, 0
    for bit in bits + number(crc, 15):
        run = run + 1 if bit == last else 1
        last = bit
        if run == 5:
            stuffed, last, run = stuffed + 1, 1 - bit, 1
    return len(bits) + 15 + stuffed + 13


def check_load(frames: list[Frame]) -> None:
    told = [frame for frame in frames if frame.id in PERIODIC]
    span_s = told[-1].time_s - told[0].time_s
    load = sum(map(bits_on_the_wire, told)) / span_s / BITS_PER_S
    longest = sum(47 + 8 * len(frame.data) + (33 + 8 * len(frame.data)) // 4 for frame in told) / span_s / BITS_PER_S
    rates = {frame.id: round(sum(f.id == frame.id for f in told) / span_s, 2) for frame in told}
    print(f"  load {100 * load:.2f} % of 250 kbit/s over {span_s:.1f} s ({100 * longest:.2f} % with every stuff bit), {len(told)} frames", flush=True)
    print("  a second:", {hex(i): rates[i] for i in sorted(rates)}, flush=True)
    assert span_s > 5 and 0.005 < load < 0.02 and longest < 0.02, (load, longest, span_s)
    assert all(not frame.fd and len(frame.data) == 8 for frame in told)
    # Never more than said; how many fewer a busy guest makes is its own.
    assert rates[BASE] <= 10.2 and all(rates[BASE + n] <= 1.2 for n in (1, 2, 5)), rates
    assert rates[BASE] > 5 and set(rates) == PERIODIC, rates


class Decoder:
    """By throwcal.dbc, and the largest errors seen, in counts of each signal."""

    def __init__(self, file: pathlib.Path, frames: list[Frame]):
        import cantools

        self.messages = cantools.database.load_file(str(file))
        self.last = {}
        self.worst = collections.defaultdict(float)
        for frame in frames:
            if frame.id in PERIODIC:
                message = self.messages.get_message_by_frame_id(frame.id)
                self.last[message.name] = message.decode(frame.data)

    def expect(self, message: str, signal: str, value) -> None:
        decoded = self.last[message][signal]
        if value is None or isinstance(value, str):
            assert str(decoded) == (value or "not available"), (message, signal, decoded, value)
            return
        scale = self.messages.get_message_by_name(message).get_signal_by_name(signal).scale
        counts = abs(float(decoded) - value) / scale
        self.worst[signal] = max(self.worst[signal], counts)
        assert counts <= 1, (message, signal, decoded, value, counts)


def rotation_vector(quaternion: list[float]) -> list[float]:
    w, *v = quaternion
    length = math.hypot(*v)
    return [2 * math.atan2(length, w) * x / length if length > 0 else 0.0 for x in v]


def check_messages(result: vm.Result, frames: list[Frame], file: pathlib.Path) -> None:
    begin, end = (float(result.text(name)) for name in ("begin", "end"))
    window = [frame for frame in frames if begin <= frame.time_s <= end]
    check_load(window)
    decoder = Decoder(file, window)
    assert len(decoder.last) == len(PERIODIC), sorted(decoder.last)
    before, after = (json.loads(result.text(name))["result"] for name in ("before", "after"))
    status, health, beat, found = (decoder.last[name] for name in ("Status", "Health", "Heartbeat", "Result"))
    for signal in ("state", "verdict", "throws", "worst_sigma_position_m", "worst_sigma_rotation_rad"):
        assert before[signal] == after[signal]
        decoder.expect("Status", signal, after[signal])
    assert after["throws"] >= 3 and after["worst_sigma_position_m"] > 0, after
    assert str(status["fault"]) == str(status["calibration_problem"]) == str(status["clamped"]) == "no", status
    assert health["cameras"] == CAMERAS and health["cameras_running"] == RUNNING, health
    for signal, keys in (("frames_lost", ("frames_lost_by_driver", "frames_damaged")), ("frames_dropped", ("frames_dropped",))):
        low, high = (sum(camera[key] for camera in now["cameras"] for key in keys) for now in (before, after))
        assert low <= health[signal] <= high, (signal, health, low, high)
    assert before["uptime_s"] - 1 <= beat["uptime_s"] <= after["uptime_s"], (beat, before["uptime_s"], after["uptime_s"])
    version = f"throwcal {beat['software_major']}.{beat['software_minor']}.{beat['software_patch']}"
    assert version == after["software"] and beat["protocol_version"] == 1 and str(beat["fd"]) == "no", beat
    check_poses(json.loads(result.text("tcp.json")), decoder)
    document = json.loads(result.text("document"))
    assert document == {"bytes": found["length"], "same": True} and found["sequence"] == status["sequence"], (document, found)
    print(f"  {len(decoder.worst)} signals of 8 cameras, the worst in counts:", {k: round(v, 3) for k, v in decoder.worst.items()}, flush=True)
    print(f"  the document: {document['bytes']} bytes, the same over ISO-TP by throwcal and by Python as over TCP", flush=True)


def check_poses(document: dict, decoder: Decoder) -> None:
    for n, camera in enumerate(document["cameras"], 1):
        pose, variances = camera["T_world_cam"], [camera["covariance"][i] for i in (0, 6, 11, 15, 18, 20)]
        for axis, place, turn in zip("xyz", pose["translation_m"], rotation_vector(pose["quaternion_wxyz"])):
            decoder.expect(f"Camera{n}_Position", f"{axis}_m", place)
            decoder.expect(f"Camera{n}_Rotation", f"r{axis}_rad", turn)
        quality = f"Camera{n}_Quality"
        decoder.expect(quality, "sigma_position_m", math.sqrt(sum(variances[:3])))
        decoder.expect(quality, "sigma_rotation_rad", math.sqrt(sum(variances[3:])))
        decoder.expect(quality, "reprojection_rms_px", camera["reprojection_rms_px"])
        decoder.expect(quality, "sightings_used", camera["sightings_used"])
        assert str(decoder.last[quality]["valid"]) == "yes" and str(decoder.last[quality]["clamped"]) == "no"
        sequences = {decoder.last[f"Camera{n}_{part}"]["sequence"] for part in ("Position", "Rotation", "Quality")}
        assert sequences == {decoder.last["Status"]["sequence"]}, sequences


def check_clients(result: vm.Result) -> None:
    assert result.files["can.json"] == result.files["tcp.json"] and len(result.files["tcp.json"]) > 2 * 4000
    document, shown = json.loads(result.text("tcp.json")), json.loads(result.text("status.json"))
    assert shown["state"] == "done" and len(shown["poses"]) == CAMERAS and shown["result"]["length"] > 0, shown
    for pose, camera in zip(shown["poses"], document["cameras"]):
        assert max(abs(a - b) for a, b in zip(pose["translation_m"], camera["T_world_cam"]["translation_m"])) <= 1e-4, (pose, camera)
    assert result.text("status").startswith("done: ") and "camera 8: " in result.text("status"), result.text("status")
    client = result.text("client").splitlines()
    assert len(client) == 3 * CAMERAS and any(line.startswith("('Camera8_Quality', {") for line in client), client
    assert result.text("down") == "throwcal: can0 is down: ip link set can0 up type can bitrate 500000\n1\n", result.text("down")
    assert result.text("unit7").startswith("throwcal: no box is heard on can0 as unit 7 within 5 s; "), result.text("unit7")
    assert result.text("unit7").endswith("\n1\n"), result.text("unit7")


def check_commands(result: vm.Result) -> None:
    answers = json.loads(result.text("commands"))
    frozen = answers.pop("a document begun before")
    assert frozen["same"] and frozen["bytes"] > 2 * 4000 and frozen["newest_bytes"] < frozen["bytes"], frozen
    outcomes = {name: answer["outcome"] for name, answer in answers.items()}
    print(f"  commands: {outcomes}", flush=True)
    assert outcomes == {
        "no key": "forbidden",
        "a wrong key": "forbidden",
        "nothing": "unknown",
        "seven bytes": "malformed",
        "a block too many": "refused",
        "start": "ok",
        "the same start": "ok",
        "another start": "refused",
        "stop": "ok",
        **{f"wrong {n}": "forbidden" for n in range(4)},
        "wrong 4": "locked",
        "right, but locked": "locked",
    }, outcomes
    first, before = answers["start"], answers["a wrong key"]
    assert answers["the same start"] == first and answers["another start"]["session"] == first["session"] == before["session"] + 1, answers
    assert re.fullmatch(r"capturing, session \d+: throw the ball\n", result.text("start")), result.text("start")
    assert result.text("abort") == "idle: 0 throws\n", result.text("abort")
    stopped = json.loads(result.text("stopped"))["result"]
    assert stopped["state"] == "done", stopped
    assert result.text("stop").startswith(f"done: {stopped['throws']} throw"), (result.text("stop"), stopped)
    assert result.text("wrong").startswith("throwcal: the box says: forbidden; ") and result.text("wrong").endswith("\n1\n"), result.text("wrong")


def check_faults(result: vm.Result) -> None:
    can = json.loads(result.text("last"))["result"]["can"]
    (lost, uptime, ticks), _, (later_lost, later_uptime, later_ticks) = (
        [float(n) for n in line.split()] for line in result.text("full").splitlines()
    )
    rate, busy = (later_lost - lost) / (later_uptime - uptime), (later_ticks - ticks) / 100 / (later_uptime - uptime)
    print(f"  queue full: {rate:.1f} frames a second left out, {100 * busy:.0f} % of the processor (the cameras with it)\n  {can}", flush=True)
    assert rate < 30, "each frame is tried once"
    assert can["bus_off"] == 2 and can["error_passive"] == 1 and can["queue_full"] >= 80 and can["wrong_keys"] == 7, can
    assert can["reopened"] == 4 and can["problem"] is None, can
    assert result.text("across").startswith("done: "), result.text("across")
    ids = {frame.id for frame in frames_of(result.text("again"))}
    assert BASE in ids and any(BASE + 8 <= i for i in ids), ids
    log = result.text("log")
    for told, times in (
        ("there is no interface can0", 3),
        ("can0 is down: ", 2),
        ("can0 is off the bus (bus-off)", 1),
        ("or no carrier", 1),
        ("error-passive", 1),
        ("its queue is full", 1),
        ("without the box's key", 1),
        ("not taken to its end", 1),
        ("can0 is up", 1),
        ("can0 is back", 4),
    ):
        assert log.count(told) == times, f"{told!r}: {log.count(told)} times, expected {times}\n{log}"


def check_fd(result: vm.Result) -> None:
    frames = frames_of(result.text("candump.fd"))
    base = BASE + 3 * 0x20
    assert result.files["fd.json"] == result.files["fd.tcp.json"] and len(result.files["fd.json"]) > 2 * 4000
    long = [frame for frame in frames if frame.id == base + 6]
    told = [frame for frame in frames if frame.id - 3 * 0x20 in PERIODIC]
    print(f"  CAN FD: {len(long)} frames of up to {max(len(f.data) for f in long)} bytes for the document, {len(told)} classic ones", flush=True)
    assert all(frame.fd for frame in long) and max(len(frame.data) for frame in long) == 64, long[:3]
    assert told and not any(frame.fd for frame in told)
    assert "fd0 carries no CAN FD frames" in result.text("log")


def run(kernel: int, files: dict, script: str, options: tuple[str, ...]) -> vm.Result:
    result = vm.run_in_guest(kernel, files, PRELUDE + script, 900, ("--icount", "--memory", "2048", *options))
    print(f"kernel {kernel}: {result.total_s:.0f} s", flush=True)
    said = {name: content[-3000:] for name, content in result.files.items() if not name.startswith("candump")}
    assert result.rc == 0, f"exit status {result.rc}\n{result.output}\n{said}"
    return result


def on_cards(kernel: int, files: dict) -> None:
    """The same on CAN cards that QEMU plays: a real driver, two ends of one bus."""
    cards = run(kernel, files, CARDS, ("--can-cards", "2"))
    flooded, last = (json.loads(cards.text(name))["result"]["can"] for name in ("flooded", "last"))
    print(f"  kvaser_pci: flooded {flooded}", flush=True)
    assert last["state"] == "up" and last["reopened"] == 1, last
    assert cards.files["can.json"] == cards.files["tcp.json"]
    assert cards.text("across").startswith("done: "), cards.text("across")
    assert cards.text("no_isotp") == "throwcal: this machine's kernel has no ISO-TP: modprobe can-isotp\n1\n", cards.text("no_isotp")
    assert " 684#046307" in cards.text("unsupported") and last["isotp_problem"] is None, (cards.text("unsupported"), last)


def main() -> None:
    build = pathlib.Path(sys.argv[sys.argv.index("--build") + 1])
    source = pathlib.Path(sys.argv[sys.argv.index("--source") + 1])
    packages = need_packages(build)
    sys.path.insert(0, str(packages))
    database = source / "firmware" / "throwcal.dbc"
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        rig = make_state(build, folder)
        files = {
            "throwcal": build / "throwcal",
            "throwcald": build / "throwcald",
            "throwcal.dbc": database,
            "can_talk.py": vm.HERE / "can_talk.py",
            "can_client.py": vm.HERE.parent / "clients" / "can_client.py",
            "state.tar": packed(folder / "state", "state", folder / "state.tar"),
            "packages.tar": packed(packages, "packages", folder / "packages.tar"),
            "rig.toml": guests_rig(rig, "can0", 0, False),
            "fd.toml": guests_rig(rig, "fd0", 3, True),
        }
        for kernel in KERNELS:
            result = run(kernel, files, SCRIPT, ())
            check_messages(result, frames_of(result.text("candump")), database)
            check_clients(result)
            check_commands(result)
            check_faults(result)
            check_fd(result)
            if os.environ.get("THROWCAL_LONG"):
                on_cards(kernel, files)
            else:
                print("  not on emulated cards; THROWCAL_LONG=1 does that, too")


if __name__ == "__main__":
    main()
