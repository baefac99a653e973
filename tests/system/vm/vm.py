# SPDX-License-Identifier: BSD-3-Clause
"""A virtual machine with real kernel drivers for a test: files go in, a script runs, what it left in /share/out comes back."""
import dataclasses
import pathlib
import shutil
import subprocess
import sys
import tempfile
import time

HERE = pathlib.Path(__file__).parent


@dataclasses.dataclass
class Result:
    rc: int
    output: str  # the console: the kernel's last words, what the script said
    files: dict[str, bytes]  # by path below /share/out
    boot_s: float  # until the script began
    total_s: float

    def text(self, name: str) -> str:
        return self.files[name].decode()


def skip(why: str) -> None:
    print("skipped:", why, flush=True)
    sys.exit(77)


def need_image(kernel: int, *extra: str) -> None:
    """Makes the image where there is none; ends the test with 77 where this machine cannot."""
    made = subprocess.run([HERE / "image", str(kernel), *extra], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    if made.returncode != 0:
        skip(f"needs the virtual machine's image: {made.stderr.strip()[-2000:]}")
    print(made.stderr, end="", flush=True)


def run_in_guest(kernel: int, files: dict[str, pathlib.Path | str], script: str, timeout: int = 60, options: tuple[str, ...] = ()) -> Result:
    """Runs a bash script in /share of a fresh machine (kernel of Debian 12 or 13), with `files` there: the copy of a path, or a text.
    `options` are those of `run`."""
    need_image(kernel, *(option for option in options if option == "--libcamera"))
    with tempfile.TemporaryDirectory() as folder:
        share = pathlib.Path(folder)
        for name, content in (files | {"run.sh": script}).items():
            if isinstance(content, str):
                (share / name).write_text(content)
            else:
                shutil.copy(content, share / name)
        (share / "out").mkdir()
        lines, began, boot_s = [], time.monotonic(), float("nan")
        command = [HERE / "run", "--kernel", str(kernel), "--timeout", str(timeout), *options, share]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace") as machine:
            for line in machine.stdout:
                lines.append(line)
                if line.startswith("guest: run.sh begins"):
                    boot_s = time.monotonic() - began
        total_s = time.monotonic() - began
        if boot_s != boot_s:
            skip(f"needs a machine on which the virtual one boots: {''.join(lines)[-2000:]}")
        out = {str(path.relative_to(share / "out")): path.read_bytes() for path in (share / "out").rglob("*") if path.is_file()}
        return Result(machine.returncode, "".join(lines), out, boot_s, total_s)
