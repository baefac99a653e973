#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""The disk image of the box, booted by BIOS, its power cut while it captures, and booted again by UEFI: it is the same box, and lost nothing.

Only with THROWCAL_LONG=1, as root; makes the packages and the image where there are none (build/package, build/image)."""

import contextlib
import hashlib
import os
import pathlib
import shutil
import socket
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request

sys.path.insert(0, str(pathlib.Path(__file__).parents[1]))
import box
import vm

SOURCE = pathlib.Path(__file__).parents[3]
SUITE = os.environ.get("THROWCAL_SUITE", "bookworm")
PATIENCE_S = 600  # for a boot, on a loaded machine
FLIGHT_S = 60  # a session may be cut with a throw or without; an emulated processor can't keep up with two cameras
SERIAL, HOST_NAME = "To.Be 42/7", "throwcal-to-be-42-7"
DISK_BYTES = 4 << 30
OVMF = pathlib.Path("/usr/share/OVMF")
RIG = ("--cameras", "2", "--width", "160", "--height", "120", "--focal", "120", "--fps", "15", "--seed", "3")

# Laid over the root file system: what looks at the box from inside. A line `KEY VALUE` each; several of one key are several lines of it.
UNIT = """[Service]
Type=exec
ExecStart=/usr/lib/throwcal/look
"""
LOOK = r"""#!/bin/bash
until [ -e /dev/virtio-ports/report ]; do sleep 0.2; done
exec > /dev/virtio-ports/report
tell() { sed "s/^/$1 /"; }
systemctl is-system-running --wait | tell state
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
networkctl --no-legend --no-pager | tell link
resolvectl mdns | tell mdns
ip -details link show can0 | tell can
cat /var/lib/throwcal/token | tell token
systemd-analyze | tell analyze
systemd-analyze blame --no-pager | head -n 8 | tell blame
grep VmRSS /proc/$(systemctl show -p MainPID --value throwcald)/status | tell memory
systemctl show -p MemoryPeak throwcald | tell memory
free -m | tell memory
journalctl -b -u throwcal-configure -o cat --no-pager | tell configure
journalctl -b -p warning -o short --no-pager | tell warning
cat /usr/lib/throwcal/packages | wc -l | tell packages
echo yes | tell end
"""


def need(condition: bool, what: str) -> None:
    if not condition:
        print("skipped:", what, flush=True)
        sys.exit(77)


def make_image(folder: pathlib.Path) -> pathlib.Path:
    """The image with what looks at it from inside; made anew when anything that goes into it changes."""
    packages = pathlib.Path(os.environ.get("THROWCAL_PACKAGES", SOURCE / "build" / "package" / f"{SUITE}-amd64"))
    if not list(packages.glob("*.deb")):
        subprocess.run([SOURCE / "deploy" / "package", "--suite", SUITE, "--arch", "amd64"], check=True)
    add = folder / "add"
    units = add / "etc" / "systemd" / "system"
    (units / "multi-user.target.wants").mkdir(parents=True)
    (units / "look.service").write_text(UNIT)
    (units / "multi-user.target.wants" / "look.service").symlink_to("/etc/systemd/system/look.service")
    look = add / "usr" / "lib" / "throwcal" / "look"
    look.parent.mkdir(parents=True)
    look.write_text(LOOK)
    look.chmod(0o755)
    files = [SOURCE / "deploy" / "image", *(path for path in (SOURCE / "deploy" / "image.d").rglob("*") if path.is_file() and path.suffix != ".md")]
    content = b"".join(path.read_bytes() for path in [*sorted(files), *sorted(packages.glob("throwcal*_*_amd64.deb")), look])
    image = SOURCE / "build" / "image" / f"test-{SUITE}-{hashlib.sha256(content).hexdigest()[:12]}.img"
    if not image.exists():
        for old in image.parent.glob(f"test-{SUITE}-*"):
            old.unlink()
        began = time.monotonic()
        new = image.with_suffix(".new")
        made = subprocess.run(
            [SOURCE / "deploy" / "image", "--suite", SUITE, "--arch", "amd64", "--packages", packages, "--add", add, "--output", new],
            stdout=subprocess.PIPE,
            check=True,
            text=True,
        )
        print(f"{made.stdout.strip().replace(str(new), image.name)}; made in {time.monotonic() - began:.0f} s", flush=True)
        new.rename(image)
    return image


def put_on_boot_partition(disk: pathlib.Path, **files: str) -> None:
    """With a laptop, as it were. An underscore stands for the dot."""
    with tempfile.TemporaryDirectory() as folder:
        for name, text in files.items():
            path = pathlib.Path(folder) / name.replace("rig_toml", "rig.toml")
            path.write_text(text)
            subprocess.run(["mcopy", "-o", "-i", f"{disk}@@1M", path, f"::/{path.name}"], check=True, env={**os.environ, "MTOOLS_SKIP_CHECK": "1"})


class Machine:
    """A board with that disk. Leaving its context cuts the power."""

    def __init__(self, disk: pathlib.Path, firmware: str, folder: pathlib.Path):
        self.console, self.report_file = folder / f"console-{firmware}", folder / f"report-{firmware}"
        self.ports = {}
        for port in (22, 7710, 8080):
            with socket.socket() as free:
                free.bind(("127.0.0.1", 0))
                self.ports[port] = free.getsockname()[1]
        forwards = "".join(f",hostfwd=tcp:127.0.0.1:{ours}-:{theirs}" for theirs, ours in self.ports.items())
        uefi = []
        if firmware == "uefi":
            code, variables = sorted(OVMF.glob("OVMF_CODE_4M.fd")), sorted(OVMF.glob("OVMF_VARS_4M.fd"))
            uefi = ["-drive", f"if=pflash,format=raw,readonly=on,file={code[0]}", "-drive", f"if=pflash,format=raw,snapshot=on,file={variables[0]}"]
        self.began = time.monotonic()
        self.process = subprocess.Popen(
            ["qemu-system-x86_64", "-accel", "tcg,thread=multi", "-smp", "2", "-cpu", "Nehalem", "-machine", "q35", "-m", "1024",
             "-no-reboot", "-display", "none", "-nodefaults", "-monitor", "none", "-vga", "std", "-serial", f"file:{self.console}", *uefi,
             "-smbios", f"type=1,serial={SERIAL},uuid=4c4c4544-0042-3510-8052-b4c04f4e4d31",
             "-drive", f"file={disk},format=raw,if=none,id=disk,cache=unsafe", "-device", "ide-hd,drive=disk",
             "-netdev", f"user,id=net{forwards}", "-device", "e1000,netdev=net", "-object", "can-bus,id=bus", "-device", "kvaser_pci,canbus=bus",
             "-device", "virtio-serial-pci", "-chardev", f"file,id=report,path={self.report_file}",
             "-device", "virtserialport,chardev=report,name=report"], stdin=subprocess.DEVNULL)  # fmt: skip

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.kill()
        self.process.wait()

    def screen(self) -> str:
        return self.console.read_text(errors="replace").replace("\r", "") if self.console.exists() else ""

    def until(self, condition, what: str):
        deadline = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline and self.process.poll() is None:
            with contextlib.suppress(OSError):
                if value := condition():
                    return value
            time.sleep(0.5)
        raise AssertionError(f"not within {PATIENCE_S} s: {what}\n{self.screen()[-3000:]}")

    def get(self, path: str) -> str:
        with urllib.request.urlopen(f"http://127.0.0.1:{self.ports[8080]}{path}", timeout=10) as answer:
            return answer.read().decode()

    def healthy(self) -> float:
        """Waits until the box says so; returns how long that took from power on."""
        self.until(lambda: self.get("/healthz").strip() == "ok", "healthy")
        return time.monotonic() - self.began

    def report(self) -> dict[str, list[str]]:
        """What was seen from inside."""
        text = self.until(lambda: (told := self.report_file.read_text(errors="replace")).endswith("\nend yes\n") and told, "the report from inside")
        told = {}
        for line in text.splitlines():
            key, _, value = line.partition(" ")
            told.setdefault(key, []).append(value)
        return told

    def ssh_banner(self) -> bytes:
        """What who connects to ssh's port is told."""
        with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", self.ports[22]), timeout=10) as connection:
            return connection.recv(100)
        return b""

    def client(self):
        return box.Client(self.ports[7710])


def is_a_box(machine: Machine, firmware: str) -> dict[str, list[str]]:
    """What holds for each start."""
    ready_s = machine.healthy()
    told = machine.report()
    for key in ("analyze", "blame", "memory", "warning"):
        print(*(f"{firmware}: {key}: {line}" for line in told.get(key, [])), sep="\n", flush=True)
    print(f"{firmware}: healthy {ready_s:.0f} s after power on", flush=True)
    assert told["state"] == ["running"] and "failed" not in told, told
    assert told["tainted"] == ["0"], told
    assert told["hostname"] == [HOST_NAME], told
    assert told["root"][0].split(",")[0] == "ro" and "Read-only file system" in told["touched"][0], told
    assert int(told["data"][0]) > (DISK_BYTES - (3 << 30)) * 0.9, told["data"]
    assert len(told["mount"]) == 3 and all("[/" in source for source in told["mount"]), told
    assert ("efi" in told) == (firmware == "uefi"), told
    assert {"7710", "8080"} <= set(told["port"]), told["port"]
    assert any("bitrate 500000" in line for line in told["can"]) and any("restart-ms 100" in line for line in told["can"]), told["can"]
    assert any("Link" in line and line.endswith("yes") for line in told["mdns"]), told["mdns"]
    assert '"state"' in machine.get("/api/v1/status")
    with machine.client() as client:
        assert client.call("status.get")["state"] != "fault"
    machine.until(lambda: f"{HOST_NAME} login:" in machine.screen(), "the prompt on the console")
    machine.until(lambda: "http://10.0.2.15:8080" in machine.screen() and "throwcald runs" in machine.screen(), "address and state on the console")
    return told


def story(build: pathlib.Path, folder: pathlib.Path) -> None:
    image = make_image(folder)
    disk = folder / "disk.img"
    subprocess.run(["cp", "--sparse=always", image, disk], check=True)
    os.truncate(disk, DISK_BYTES)
    box.simulate(build, folder / "site", *RIG)
    rig = (folder / "site" / "rig.toml").read_text().replace("127.0.0.1", "0.0.0.0")
    put_on_boot_partition(disk, rig_toml=rig)

    with Machine(disk, "bios", folder) as machine:
        first = is_a_box(machine, "bios")
        assert any("Took rig.toml" in line for line in first["configure"]), first["configure"]
        assert "22" not in first["port"] and machine.ssh_banner() == b"", "ssh is on"
        with machine.client() as client:
            client.may_change(first["token"][0])
            session = client.call("capture.start", {"until": "stopped"})["session"]
            deadline = time.monotonic() + FLIGHT_S
            while (seen := client.call("status.get"))["throws"] < 1 and time.monotonic() < deadline:
                time.sleep(1)
            print(f"before the power cut: session {session}, {seen['throws']} throws", flush=True)

    # The power is out. A rig file that is none, and somebody's key.
    subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", folder / "key"], check=True)
    put_on_boot_partition(disk, rig_toml=rig + "\nthis = is none\n", authorized_keys=(folder / "key.pub").read_text())

    with Machine(disk, "uefi", folder) as machine:
        second = is_a_box(machine, "uefi")
        assert second["machine-id"] == first["machine-id"] and len(first["machine-id"][0]) == 32, (first, second)
        assert second["token"] == first["token"]
        with machine.client() as client:
            sessions = {one["session"]: one for one in client.call("session.list")}
        assert session in sessions, sessions
        print(f"after the power cut: session {sessions[session]}", flush=True)
        assert any("Refused rig.toml" in line and "line" in line for line in second["configure"]), second["configure"]
        assert "Refused rig.toml" in machine.screen()
        machine.until(lambda: machine.ssh_banner().startswith(b"SSH-2.0"), "ssh")
        login = ["ssh", "-i", folder / "key", "-p", str(machine.ports[22]), "-o", "StrictHostKeyChecking=no", "-o", "UserKnownHostsFile=/dev/null"]
        said = subprocess.run([*login, "-o", "ConnectTimeout=60", "root@127.0.0.1", "hostname"], stdout=subprocess.PIPE, text=True, check=True).stdout
        assert said.strip() == HOST_NAME, said


def main() -> None:
    need(bool(os.environ.get("THROWCAL_LONG")), "boots the disk image with THROWCAL_LONG=1 only")
    need(os.geteuid() == 0, "needs root")
    build = pathlib.Path(sys.argv[sys.argv.index("--build") + 1]).resolve()
    subprocess.run([SOURCE / "deploy" / "install-dependencies", "qemu-system-x86", "ovmf", "mtools", "openssh-client"], check=True)
    with tempfile.TemporaryDirectory() as folder:
        story(build, pathlib.Path(folder))


if __name__ == "__main__":
    main()
