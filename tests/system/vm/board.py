# SPDX-License-Identifier: BSD-3-Clause
"""A board that boots the disk image: software emulation of a processor that does an instruction a nanosecond, whatever this machine's load, with a
keyboard, two CAN cards on one bus, an LED, and whoever plugs in, presses, logs in, or cuts the power."""

import contextlib
import json
import os
import pathlib
import socket
import subprocess
import sys
import tempfile
import time
import urllib.request

sys.path.insert(0, str(pathlib.Path(__file__).parents[1]))
import box

SOURCE = pathlib.Path(__file__).parents[3]
PATIENCE_S = 900  # for whatever must happen sooner or later; a start takes one to three minutes
SERIAL, UUID = "To.Be 42/7", "4c4c4544-0042-3510-8052-b4c04f4e4d31"
CLOCK = ["-accel", "tcg,thread=single", "-smp", "1", "-icount", "shift=0"]
FIRMWARE = {
    ("amd64", "uefi"): ("OVMF/OVMF_CODE_4M.fd", "OVMF/OVMF_VARS_4M.fd"),
    ("arm64", "uefi"): ("AAVMF/AAVMF_CODE.fd", "AAVMF/AAVMF_VARS.fd"),
}
HARDWARE = {
    "amd64": ["qemu-system-x86_64", "-cpu", "Nehalem", "-machine", "q35", "-vga", "std",
              "-device", "ide-hd,drive=disk", "-device", "e1000,netdev=net"],
    "arm64": ["qemu-system-aarch64", "-cpu", "cortex-a72", "-machine", "virt", "-device", "virtio-blk-pci,drive=disk",
              "-device", "virtio-net-pci,netdev=net", "-device", "qemu-xhci", "-device", "usb-kbd", "-device", "ramfb"],
}  # fmt: skip


def packages(arch: str) -> list[str]:
    """What this machine must have to be one."""
    return {"amd64": ["qemu-system-x86", "ovmf"], "arm64": ["qemu-system-arm", "qemu-efi-aarch64"]}[arch] + ["mtools", "openssh-client", "e2fsprogs"]


def mtools(disk: pathlib.Path, partition: str, command: str, *arguments: str | pathlib.Path) -> str:
    image = f"{disk}@@{partition_offset(disk, partition)}"
    environment = {**os.environ, "MTOOLS_SKIP_CHECK": "1"}
    return subprocess.run([command, "-i", image, *arguments], stdout=subprocess.PIPE, check=True, text=True, env=environment).stdout


def put_on_partition(disk: pathlib.Path, partition: str, files: dict[str, str | None]) -> None:
    """With a laptop, as it were; None takes a file away."""
    for name, text in files.items():
        with tempfile.NamedTemporaryFile("w") as file:
            if text is None:
                mtools(disk, partition, "mdel", f"::/{name}")
            else:
                file.write(text)
                file.flush()
                mtools(disk, partition, "mcopy", "-o", file.name, f"::/{name}")


def partition_offset(disk: pathlib.Path, name: str) -> int:
    told = json.loads(subprocess.run(["/sbin/sfdisk", "--json", disk], stdout=subprocess.PIPE, check=True).stdout)["partitiontable"]
    return next(part["start"] for part in told["partitions"] if part["name"] == name) * told.get("sectorsize", 512)


def on_partition(disk: pathlib.Path, partition: str, request: str) -> str:
    """What debugfs answers."""
    file_system = f"{disk}?offset={partition_offset(disk, partition)}"
    return subprocess.run(
        ["/sbin/debugfs", "-R", request, file_system], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, check=True, text=True
    ).stdout


def kernel_of(disk: pathlib.Path) -> str:
    lines = on_partition(disk, "throwcal-root-a", "cat /usr/lib/throwcal/packages").splitlines()
    return next(
        name for name in (line.split()[0].removeprefix("linux-image-") for line in lines if line.startswith("linux-image-")) if name[0].isdigit()
    )


def journal(disk: pathlib.Path) -> list[dict]:
    """What the box kept of its journal, the oldest first."""
    with tempfile.TemporaryDirectory() as folder:
        on_partition(disk, "throwcal-data", f"rdump /journal {folder}")
        told = subprocess.run(
            ["journalctl", "-D", f"{folder}/journal", "-o", "json", "--no-pager"], stdout=subprocess.PIPE, check=True, text=True
        ).stdout
    return [json.loads(line) for line in told.splitlines()]


class Board:
    """A board with that disk and, beside it, a kit. Leaving its context cuts the power."""

    def __init__(self, arch: str, firmware: str, disk: pathlib.Path, folder: pathlib.Path, kit: pathlib.Path | None = None):
        self.key, self.console, self.monitor = folder / "key", folder / f"console-{time.monotonic():.0f}", folder / "monitor"
        self.ports = {}
        for port in (22, 7710, 8080):
            with socket.socket() as free:
                free.bind(("127.0.0.1", 0))
                self.ports[port] = free.getsockname()[1]
        forwards = "".join(f",hostfwd=tcp:127.0.0.1:{ours}-:{theirs}" for theirs, ours in self.ports.items())
        flash = []
        if firmware == "uefi":
            code, variables = FIRMWARE[arch, firmware]
            flash = ["-drive", f"if=pflash,format=raw,readonly=on,file=/usr/share/{code}",
                     "-drive", f"if=pflash,format=raw,snapshot=on,file=/usr/share/{variables}"]  # fmt: skip
        kits = ["-drive", f"file={kit},format=raw,if=none,id=kit,readonly=on", "-device", "virtio-blk-pci,drive=kit,serial=kit"] if kit else []
        program, *hardware = HARDWARE[arch]
        self.monitor.unlink(missing_ok=True)
        self.began = time.monotonic()
        self.process = subprocess.Popen(
            [program, *CLOCK, "-m", "2048", "-no-reboot", "-display", "none", "-nodefaults", "-serial", f"file:{self.console}",
             "-drive", f"file={disk},format=raw,if=none,id=disk,cache=unsafe", "-netdev", f"user,id=net{forwards}", *hardware, *flash, *kits,
             "-smbios", f"type=1,serial={SERIAL},uuid={UUID}", "-qmp", f"unix:{self.monitor},server=on,wait=off", "-device", "sdhci-pci",
             "-object", "can-bus,id=bus", "-device", "kvaser_pci,canbus=bus", "-device", "kvaser_pci,canbus=bus"],
            stdin=subprocess.DEVNULL)  # fmt: skip

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.kill()
        self.process.wait()

    def screen(self) -> str:
        return self.console.read_text(errors="replace").replace("\r", "") if self.console.exists() else ""

    def until(self, condition, what: str, patience_s: float = PATIENCE_S):
        """Asks again until it holds; returns what it returned."""
        deadline = time.monotonic() + patience_s
        while time.monotonic() < deadline and self.process.poll() is None:
            with contextlib.suppress(OSError):
                if value := condition():
                    return value
            time.sleep(0.5)
        raise AssertionError(f"not within {patience_s} s: {what}\n{self.screen()[-3000:]}")

    def get(self, path: str) -> bytes:
        with urllib.request.urlopen(f"http://127.0.0.1:{self.ports[8080]}{path}", timeout=30) as answer:
            return answer.read()

    def answers(self) -> float:
        """Waits until the box answers at all; returns how long that took from power on."""
        self.until(lambda: self.get("/api/v1/status"), "an answer")
        return time.monotonic() - self.began

    def client(self) -> box.Client:
        return box.Client(self.ports[7710])

    def ask(self, command: str, **arguments) -> None:
        """Of the machine, not of the box."""
        with socket.socket(socket.AF_UNIX) as connection, connection.makefile("rb") as lines:
            connection.settimeout(60)
            connection.connect(str(self.monitor))
            for request in ({"execute": "qmp_capabilities"}, {"execute": command, "arguments": arguments}):
                connection.sendall(json.dumps(request).encode())
                while "return" not in (answer := json.loads(lines.readline())):
                    assert "error" not in answer, answer

    def press(self, key: str) -> None:
        self.ask("send-key", keys=[{"type": "qcode", "data": key}], **{"hold-time": 200})

    def switch_off(self) -> None:
        """By the power button."""
        self.ask("system_powerdown")
        assert self.process.wait(PATIENCE_S) == 0

    def rests(self) -> bool:
        """Whether its processor has little to do; looks for five seconds."""

        def processor_s() -> float:
            used = pathlib.Path(f"/proc/{self.process.pid}/stat").read_text().rsplit(")", 1)[1].split()[11:13]
            return sum(map(int, used)) / os.sysconf("SC_CLK_TCK")

        before = processor_s()
        time.sleep(5)
        return processor_s() - before < 1.5

    def ssh_banner(self) -> bytes:
        """What who connects to ssh's port is told."""
        with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", self.ports[22]), timeout=30) as connection:
            return connection.recv(100)
        return b""

    def run(self, script: str) -> str:
        """What a bash script, run by who logs in as root, prints; its errors are printed here."""
        login = ["ssh", "-i", self.key, "-p", str(self.ports[22]), "-o", "StrictHostKeyChecking=no", "-o", "UserKnownHostsFile=/dev/null"]
        login += ["-o", "LogLevel=ERROR", "-o", "ConnectTimeout=300", "root@127.0.0.1", "bash", "-s"]
        done = subprocess.run(login, input=script, stdout=subprocess.PIPE, text=True, timeout=PATIENCE_S)
        assert done.returncode == 0, f"{script}\nended with {done.returncode}\n{done.stdout[-3000:]}"
        return done.stdout

    def can_log_in(self) -> bool:
        self.until(lambda: self.ssh_banner().startswith(b"SSH-2.0"), "ssh")
        return True
