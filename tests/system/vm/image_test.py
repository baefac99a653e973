#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""The main job on the box's disk image: switched on, its rig file put on with a laptop, four cameras that show five throws, a key pressed, the
calibration fetched over TCP, HTTP and CAN; then the power is cut in a session, and it comes up with all it had.

Only with THROWCAL_LONG=1, as root; makes packages and image where there are none (build/package, build/image). THROWCAL_SUITE and THROWCAL_ARCH are
deploy/image's; this machine's Debian and amd64."""

import hashlib
import json
import math
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import time

import board
import box

SOURCE = board.SOURCE
SUITE = os.environ.get("THROWCAL_SUITE", "bookworm")
ARCH = os.environ.get("THROWCAL_ARCH", "amd64")
FIRMWARES = ("bios", "uefi") if ARCH == "amd64" else ("uefi", "uefi")  # of the first starts, and of those after the power cut
HOST_NAME = "throwcal-to-be-42-7"
LOADER = "loader/entries/throwcal-a.conf"  # what systemd-boot boots
DISK_BYTES = 4 << 30
CAMERAS, THROWS, FPS, WIDTH, HEIGHT = 4, 5, 30, 320, 240
NODES = [f"/dev/video{30 + i}" for i in range(CAMERAS)]
CALM_S = 8  # before the first throw; then it all begins again
LATE_PRESS_S = 3  # so soon after a session ended itself a press means that one
FOREIGN_MODULE = 1 << 12 | 1 << 13  # the taint of v4l2loopback: not of the tree, not signed
RING_BYTES = CAMERAS * 32 * WIDTH * HEIGHT  # capture/rig.h: ring_slots

# What is on the box's panel.
PANEL = """
[can]
interface = "can0"

[button]
key = "KEY_F12"
grab = true

[light]
led = "mmc0::"
"""

# A line `KEY VALUE` each; several of one key are several lines of it.
LOOK = r"""
tell() { sed "s/^/$1 /"; }
systemctl is-system-running --wait | tell state
systemctl reload throwcald 2>&1 | tell reload
systemctl --failed --plain --no-legend | tell failed
cat /etc/machine-id | tell machine-id
hostnamectl --static | tell hostname
cat /proc/sys/kernel/tainted | tell tainted
findmnt -no OPTIONS / | tell root
touch /etc/written 2>&1 | tell touched
findmnt -bno SIZE /data | tell data
for place in /var/lib/throwcal /etc/throwcal /var/log/journal; do findmnt -no SOURCE "$place" | tell mount; done
ls /sys/firmware/efi > /dev/null 2>&1 && echo yes | tell efi
ss -Htln | sed 's/.*:\([0-9]*\) .*:.*/\1/' | sort -u | tell port
resolvectl mdns | tell mdns
ip -details link show can0 | tell can
ip link show can0 | tell can
ip link set can1 up 2>&1 | tell can
systemd-analyze | tell analyze
systemd-analyze blame --no-pager | head -n 8 | tell blame
systemd-analyze critical-chain throwcald.service --no-pager | tail -n +4 | tell chain
free -m | tell memory
journalctl -b -u throwcal-configure -o cat --no-pager | tell configure
journalctl -b -p warning -o short --no-pager | tell warning
"""

CAMERAS_COME = """
set -e
mkdir -p /run/kit
mount -o ro /dev/disk/by-id/virtio-kit /run/kit
modprobe videodev
insmod /run/kit/v4l2loopback.ko devices={cameras} video_nr={numbers} max_buffers=8
udevadm settle
systemd-run --quiet --unit=players --property=Type=exec --property=StandardOutput=null /run/kit/loopback_player {width} {height} GREY {fps}/0 {players}
"""

# As throwcald, in its sandbox: what may not be done, and what must. Then the threads that take frames, and the light.
PROBE = r"""
unit=/run/systemd/system/probe.service
sed -E '/^(ExecStart|ExecStartPost|ExecReload|Restart|WatchdogSec|Condition)/d; s/^Type=.*/Type=oneshot/' /lib/systemd/system/throwcald.service > "$unit"
key=$(grep -l . /sys/class/input/event*/device/capabilities/led | head -n 1 | cut -d / -f 5)
sed -i "s|^.Service.$|&\nExecStart=/run/kit/sandbox_probe $(findmnt -no SOURCE /) {node} /dev/input/$key /sys/class/leds/mmc0::/brightness|" "$unit"
systemctl daemon-reload
systemctl start probe
journalctl -b -u probe -o cat --no-pager
"""

THREADS = r"""
for task in /proc/$(systemctl show -p MainPID --value throwcald)/task/*; do echo "$(cat $task/comm) $(cut -d ' ' -f 41 $task/stat)"; done
"""

# It ends at once, with a reason; and, once that has gone, at an address that comes later.
NOT_AT_ONCE = r"""
mkdir -p /run/systemd/system/throwcald.service.d
start() {{
  printf '[Service]\nExecStart=\nExecStart=/usr/bin/throwcald --config /etc/throwcal/rig.toml %s\n' "$1" > /run/systemd/system/throwcald.service.d/test.conf
  systemctl daemon-reload
  systemctl restart throwcald
}}
start '--listen 0.0.0.0:8080' # HTTP is there
cat /run/throwcal/issue.d/4-throwcald.issue
systemctl reset-failed throwcald
start '--listen {address}:7710'
ip address add {address}/32 dev lo
throwcal status --host {address} | head -n 1
rm /run/systemd/system/throwcald.service.d/test.conf
systemctl daemon-reload
systemctl stop throwcald
cat /run/throwcal/issue.d/4-throwcald.issue
systemctl start throwcald
"""

# The rig file that was put on differs from the box's, and can't be kept.
NOT_KEPT = r"""
chattr +i /data/rig
rm /run/throwcal/authorized_keys
systemctl restart throwcal-configure 2> /dev/null || echo failed
cat /run/throwcal/issue.d/2-rig.issue
test -s /run/throwcal/authorized_keys && echo "who has the key gets in"
chattr -i /data/rig
systemctl restart throwcal-configure
cat /run/throwcal/issue.d/2-rig.issue
"""

MEMORY = r"""
grep -E "VmRSS|RssAnon|RssFile|RssShmem" /proc/$(systemctl show -p MainPID --value throwcald)/status
cd /sys/fs/cgroup/system.slice/throwcald.service
echo "its control group $(($(cat memory.current) / 1024)) kB, at most $(($(cat memory.peak) / 1024)) kB until now"
"""


def need(condition: bool, what: str) -> None:
    if not condition:
        print("skipped:", what, flush=True)
        sys.exit(77)


def say(text: str) -> None:
    print(f"{SUITE} {ARCH}: {text}", flush=True)


def make_image() -> pathlib.Path:
    """The image as everybody gets it; made anew when anything that goes into it changes."""
    packages = pathlib.Path(os.environ.get("THROWCAL_PACKAGES", SOURCE / "build" / "package" / f"{SUITE}-{ARCH}"))
    if not list(packages.glob("*.deb")):
        subprocess.run([SOURCE / "deploy" / "package", "--suite", SUITE, "--arch", ARCH, "--output", packages], check=True)
    files = [SOURCE / "deploy" / "image", *(path for path in (SOURCE / "deploy" / "image.d").rglob("*") if path.is_file() and path.suffix != ".md")]
    content = b"".join(path.read_bytes() for path in [*sorted(files), *sorted(packages.glob(f"throwcal*_*_{ARCH}.deb"))])
    image = SOURCE / "build" / "image" / f"test-{SUITE}-{ARCH}-{hashlib.sha256(content).hexdigest()[:12]}.img"
    if not image.exists():
        for old in image.parent.glob(f"test-{SUITE}-{ARCH}-*"):
            old.unlink()
        began = time.monotonic()
        new = image.with_suffix(".new")
        command = [SOURCE / "deploy" / "image", "--suite", SUITE, "--arch", ARCH, "--packages", packages, "--output", new]
        made = subprocess.run(command, stdout=subprocess.PIPE, check=True, text=True)
        say(f"{made.stdout.strip().replace(str(new), image.name)}; made in {time.monotonic() - began:.0f} s")
        new.rename(image)
    return image


class Site:
    """A scene, its films on a disk of their own, and the rig file of it."""

    def __init__(self, build: pathlib.Path, folder: pathlib.Path, kit: pathlib.Path):
        options = ("--width", str(WIDTH), "--height", str(HEIGHT), "--focal", "240", "--fps", str(FPS), "--cameras", str(CAMERAS))
        box.simulate(build, folder / "site", "--video", "--throws", str(THROWS), *options)
        self.truth = json.loads((folder / "site" / "truth.json").read_text())
        self.rig = (folder / "site" / "rig.toml").read_text().replace("127.0.0.1", "0.0.0.0").replace(
            "[target]", f"[target]\nthrows = {THROWS}"
        ) + PANEL
        films = folder / "kit"
        shutil.copytree(kit, films)
        names = [camera["name"] for camera in self.truth["cameras"]]
        for name, node in zip(names, NODES):
            self.rig = self.rig.replace('source = "simulated"', f'source = "v4l2:{node}"', 1)
            subprocess.run([build / "tests" / "raw_frames", folder / "site" / f"{name}.mkv", films / f"{name}.raw"], check=True)
        shortest = min((films / f"{name}.raw").stat().st_size for name in names)
        second = FPS * WIDTH * HEIGHT
        for path in films.glob("*.raw"):
            film = path.read_bytes()
            calm = film[: second // 2] * 2
            path.write_bytes(calm * CALM_S + film[:shortest])
        self.disk = folder / "kit.ext4"
        megabytes = sum(path.stat().st_size for path in films.iterdir()) // 1000000 + 64
        subprocess.run(["/sbin/mke2fs", "-qF", "-t", "ext4", "-O", "^has_journal", "-d", films, self.disk, f"{megabytes}M"], check=True)
        begins_ns = [round(1e6 * float((folder / "site" / f"{name}.timestamps.txt").read_text().splitlines()[1])) for name in names]
        self.players = " ".join(f"{node}=/run/kit/{name}.raw+{ns - max(begins_ns)}" for name, node, ns in zip(names, NODES, begins_ns))

    def compare(self, document: dict) -> None:
        """Each camera but the first is where it is, turned as it is, and its clock is late as it is: within its own sigmas."""
        for true, found in list(zip(self.truth["cameras"], document["cameras"]))[1:]:
            assert true["name"] == found["name"]
            variances = [found["covariance"][i] for i in (0, 6, 11, 15, 18, 20)]  # the upper triangle's diagonal
            here, there = true["T_world_cam"], found["T_world_cam"]
            product = abs(sum(a * b for a, b in zip(here["quaternion_wxyz"], there["quaternion_wxyz"])))
            figures = {
                "mm": (1e3 * math.dist(here["translation_m"], there["translation_m"]), 1e3 * math.sqrt(sum(variances[:3])), 50),
                "mrad": (2e3 * math.acos(min(1.0, product)), 1e3 * math.sqrt(sum(variances[3:])), 20),
                "ms": (1e3 * abs(true["time_offset_s"] - found["time_offset_s"]), 1e3 * found["sigma_time_offset_s"], 1),
            }
            off = ", ".join(f"{value:.3f} {unit} (sigma {sigma:.3f})" for unit, (value, sigma, _) in figures.items())
            say(f"{found['name']} is off by {off}")
            assert all(value < min(most, 4 * sigma) for value, sigma, most in figures.values()), figures


def is_a_box(machine: board.Board, firmware: str) -> dict[str, list[str]]:
    """What holds for each start with a rig file and somebody's key."""
    answers_s = machine.answers()
    machine.can_log_in()
    told = {}
    for line in machine.run(LOOK).splitlines():
        key, _, value = line.partition(" ")
        told.setdefault(key, []).append(value)
    for key in ("analyze", "blame", "chain", "memory", "warning"):
        for line in told.get(key, []):
            say(f"{firmware}: {key}: {line}")
    say(f"{firmware}: answers {answers_s:.0f} s after power on, of this machine's time")
    assert told["state"] == ["running"] and "failed" not in told, told
    assert "reload" not in told, told["reload"]
    assert told["tainted"] == ["0"], told
    assert told["hostname"] == [HOST_NAME], told
    assert told["root"][0].split(",")[0] == "ro" and "Read-only file system" in told["touched"][0], told
    assert int(told["data"][0]) > (DISK_BYTES - (3 << 30)) * 0.9, told["data"]
    assert len(told["mount"]) == 3 and all("[/" in source for source in told["mount"]), told
    assert ("efi" in told) == (firmware == "uefi"), told
    assert {"7710", "8080"} <= set(told["port"]), told["port"]
    assert any("bitrate 500000" in line for line in told["can"]) and any("restart-ms 100" in line for line in told["can"]), told["can"]
    assert any("Link" in line and line.endswith("yes") for line in told["mdns"]), told["mdns"]
    machine.until(lambda: f"{HOST_NAME} login:" in machine.screen(), "the prompt on the console")
    machine.until(lambda: "http://10.0.2.15:8080" in machine.screen() and "throwcald runs" in machine.screen(), "address and state on the console")
    return told


def starts_without_anything(machine: board.Board) -> None:
    """The first start ever: no rig file, no keys."""
    machine.until(lambda: f"{HOST_NAME} login:" in machine.screen(), "the prompt on the console")
    machine.until(lambda: "There is no rig file: put rig.toml on the partition THROWCAL." in machine.screen(), "what is missing, on the console")
    assert machine.ssh_banner() == b"", "ssh is on"


def status(client: box.Client) -> dict:
    return client.call("status.get")


def memory(machine: board.Board, when: str) -> None:
    for line in machine.run(MEMORY).splitlines():
        say(f"throwcald, {when}: {' '.join(line.split())}")


def cameras_come(machine: board.Board, site: Site, client: box.Client) -> None:
    """Plugged in while the box runs. Its sandbox holds for what is there now."""
    assert all("not plugged in" in camera["error"] for camera in status(client)["cameras"]), status(client)
    memory(machine, "no camera plugged in")
    numbers = ",".join(node.removeprefix("/dev/video") for node in NODES)
    machine.run(CAMERAS_COME.format(cameras=CAMERAS, numbers=numbers, width=WIDTH, height=HEIGHT, fps=FPS, players=site.players))
    machine.until(lambda: machine.get("/healthz").strip() == b"ok", "four cameras that run")
    memory(machine, f"idle, {CAMERAS} cameras of {WIDTH}x{HEIGHT} run; its rings take {RING_BYTES / 1e6:.1f} MB")
    probed = machine.run(PROBE.replace("{node}", NODES[0])).splitlines()
    for line in probed:
        say(f"in the sandbox: {line}")
    assert "probe: 0 wrong" in probed, probed
    policies = dict(line.rsplit(" ", 1) for line in machine.run(THREADS).splitlines())
    first = {thread for thread, policy in policies.items() if policy == "2"}  # SCHED_RR
    assert first == {f"{camera['name']}.live" for camera in site.truth["cameras"]}, policies


def says_why_it_does_not_run(machine: board.Board) -> None:
    told = machine.run(NOT_AT_ONCE.format(address="10.77.0.7")).splitlines()
    assert told[0].startswith("throwcald does not run: can't listen at 0.0.0.0:8080: Address already in use"), told
    assert " throws" in told[1] and told[2:] == ["throwcald was stopped"], told
    machine.until(lambda: "throwcald does not run: can't listen at 0.0.0.0:8080" in machine.screen(), "why, on the console")
    machine.answers()


def lets_in_who_can_mend_it(machine: board.Board) -> None:
    told = machine.run(NOT_KEPT).splitlines()
    assert told[:3] == [
        "failed",
        "What is on the partition THROWCAL could not be taken; the journal has more (journalctl -u throwcal-configure).",
        "who has the key gets in",
    ], told
    assert told[3].startswith("Refused rig.toml"), told


def light_is_on(machine: board.Board) -> bool:
    return machine.run("cat /sys/class/leds/mmc0::/brightness").strip() != "0"


def five_throws(machine: board.Board, site: Site, client: box.Client, build: pathlib.Path, folder: pathlib.Path) -> bytes:
    """A press, and five throws, which are enough; the calibration as everybody gets it. Returns the document."""
    assert status(client)["state"] == "idle", status(client)
    began = time.monotonic()
    machine.press("f12")
    machine.until(lambda: status(client)["state"] in ("capturing", "throw-seen", "warming-up"), "the press is a start")
    assert any(light_is_on(machine) for _ in range(20)), "the light is dark"
    machine.until(lambda: status(client)["throws"] >= THROWS - 1, f"{THROWS - 1} throws")
    memory(machine, f"{THROWS - 1} throws into a capture")
    machine.until(lambda: status(client)["state"] == "done", "done")
    say(f"from the first press to the calibration {time.monotonic() - began:.0f} s of this machine's time")
    told = status(client)
    lost = {camera["name"]: (camera["frames"], camera["frames_lost_by_driver"], camera["frames_dropped"]) for camera in told["cameras"]}
    say(f"of each camera frames looked at, lost, dropped: {lost}")

    tcp, http = folder / "tcp.json", machine.get("/api/v1/calibration/latest")
    fetched = subprocess.run(
        [build / "throwcal", "fetch", "--host", f"127.0.0.1:{machine.ports[7710]}", "--output", tcp, "--truth", folder / "site" / "truth.json"],
        stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    print(fetched.stdout, flush=True)
    assert fetched.returncode == 0, f"the calibration is not accepted: {fetched.returncode}"
    began = time.monotonic()
    over_can = machine.run("throwcal fetch --can can1 --output /run/can.json > /dev/null 2>&1; cat /run/can.json").encode()
    say(f"the document over CAN: {len(over_can)} bytes in {time.monotonic() - began:.0f} s with the login")
    documents = {"TCP": tcp.read_bytes(), "HTTP": http, "CAN": over_can}
    assert len({json.dumps(json.loads(text)) for text in documents.values()}) == 1, documents
    document = json.loads(http)
    assert len(document["throws"]) >= THROWS and document["verdict"] == "accepted", document
    site.compare(document)
    return http


def startup(disk: pathlib.Path) -> tuple[float, float, float | None]:
    """Of the last start [s]: kernel with initrd, user space, and from its first moment until throwcald was ready."""
    entries = journal_of_last_start(disk)
    finished = next(entry for entry in entries if entry.get("MESSAGE_ID") == "b07a249cd024414a82dd00cd181378ff")
    ready = next(
        (int(e["__MONOTONIC_TIMESTAMP"]) / 1e6 for e in entries if e.get("UNIT") == "throwcald.service" and e.get("JOB_RESULT") == "done"), None
    )
    return int(finished["KERNEL_USEC"]) / 1e6 + int(finished.get("INITRD_USEC", 0)) / 1e6, int(finished["USERSPACE_USEC"]) / 1e6, ready


def journal_of_last_start(disk: pathlib.Path) -> list[dict]:
    entries = board.journal(disk)
    return [entry for entry in entries if entry["_BOOT_ID"] == entries[-1]["_BOOT_ID"]]


def our_share_of_the_start(disk: pathlib.Path, folder: pathlib.Path) -> None:
    """A start as the box is used, and one without throwcal: both switched off by the power button."""
    loader = board.mtools(disk, "throwcal-esp", "mtype", f"::/{LOADER}")
    without = re.sub("^options .*", r"\g<0> systemd.mask=throwcald.service systemd.mask=throwcal-configure.service", loader, flags=re.MULTILINE)
    times = {}
    for what, entry in (("without throwcal", without), ("with", loader)):
        board.put_on_partition(disk, "throwcal-esp", {LOADER: entry})
        with board.Board(ARCH, "uefi", disk, folder) as machine:
            if what == "with":
                machine.answers()
            machine.until(lambda: f"{HOST_NAME} login:" in machine.screen(), "the prompt on the console")
            machine.until(machine.rests, "all that starts has started")
            assert machine.ssh_banner() == b"", "ssh is on, without a key"
            machine.switch_off()
        times[what] = startup(disk)
        kernel_s, user_s, ready_s = times[what]
        say(f"a start {what}: {kernel_s:.2f} s kernel and initrd, {user_s:.2f} s user space" + (f"; ready at {ready_s:.2f} s" if ready_s else ""))
    assert times["with"][2] and not times["without throwcal"][2], times
    ours = sum(times["with"][:2]) - sum(times["without throwcal"][:2])
    say(f"throwcal's share of a start: {ours:.2f} of {sum(times['with'][:2]):.2f} s")


def story(build: pathlib.Path, folder: pathlib.Path) -> None:
    image = make_image()
    disk = folder / "disk.img"
    subprocess.run(["cp", "--sparse=always", image, disk], check=True)
    os.truncate(disk, DISK_BYTES)
    kit = subprocess.run([SOURCE / "tests/system/vm/kit", SUITE, ARCH, board.kernel_of(disk)], stdout=subprocess.PIPE, check=True, text=True).stdout
    site = Site(build, folder, pathlib.Path(kit.strip()))
    subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", folder / "key"], check=True)

    with board.Board(ARCH, FIRMWARES[0], disk, folder) as machine:
        starts_without_anything(machine)

    board.put_on_partition(disk, "throwcal-site", {"rig.toml": site.rig, "authorized_keys": (folder / "key.pub").read_text()})
    with board.Board(ARCH, FIRMWARES[0], disk, folder, site.disk) as machine:
        first = is_a_box(machine, FIRMWARES[0])
        assert any("Took rig.toml" in line for line in first["configure"]), first["configure"]
        token = machine.run("cat /var/lib/throwcal/token")
        with machine.client() as client:
            cameras_come(machine, site, client)
            document = five_throws(machine, site, client, build, folder)
            time.sleep(LATE_PRESS_S)
            failed_and_taint = machine.run("systemctl --failed --plain --no-legend; cat /proc/sys/kernel/tainted").split()
            assert failed_and_taint == [str(FOREIGN_MODULE)], failed_and_taint
            machine.press("f12")
            machine.until(
                lambda: (told := status(client))["session"] != json.loads(document)["session"] and told["throws"], "another session's throw"
            )
            last, throws = (status(client)[key] for key in ("session", "throws"))

    # The power is out. A rig file that is none.
    board.put_on_partition(disk, "throwcal-site", {"rig.toml": site.rig + "\nthis = is none\n"})
    with board.Board(ARCH, FIRMWARES[1], disk, folder, site.disk) as machine:
        second = is_a_box(machine, FIRMWARES[1])
        assert second["machine-id"] == first["machine-id"] and len(first["machine-id"][0]) == 32, (first, second)
        assert machine.run("cat /var/lib/throwcal/token") == token
        assert any("Refused rig.toml" in line and "line" in line for line in second["configure"]), second["configure"]
        assert "Refused rig.toml" in machine.screen()
        with machine.client() as client:
            sessions = {one["session"]: one for one in client.call("session.list")}
            say(f"after the power cut: {sessions}")
            assert sessions[last]["throws"] >= throws >= 1, (last, throws, sessions)
            kept = machine.get(f"/api/v1/calibration/{json.loads(document)['id']}")
        assert kept == document, kept
        says_why_it_does_not_run(machine)
        lets_in_who_can_mend_it(machine)

    board.put_on_partition(disk, "throwcal-site", {"rig.toml": site.rig, "authorized_keys": None})
    our_share_of_the_start(disk, folder)


def main() -> None:
    need(bool(os.environ.get("THROWCAL_LONG")), "boots the disk image with THROWCAL_LONG=1 only")
    need(os.geteuid() == 0, "needs root")
    build = pathlib.Path(sys.argv[sys.argv.index("--build") + 1]).resolve()
    subprocess.run([SOURCE / "deploy" / "install-dependencies", "mmdebstrap", *board.packages(ARCH)], check=True)
    with tempfile.TemporaryDirectory() as folder:
        story(build, pathlib.Path(folder))


if __name__ == "__main__":
    main()
