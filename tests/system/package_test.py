#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""The Debian packages in fresh trees of Debian 12 and 13: installed, upgraded, removed, purged; an upgrade keeps what is the user's,
a purge leaves nothing. And what lintian says.

Takes half an hour and the network, so with THROWCAL_LONG=1 only. Needs root. THROWCAL_SUITES="bookworm" narrows it; THROWCAL_ARCH="arm64"
emulates another processor."""

import os
import pathlib
import shutil
import subprocess
import sys
import tempfile

SUITES = os.environ.get("THROWCAL_SUITES", "bookworm trixie").split()
ARCH = os.environ.get("THROWCAL_ARCH") or subprocess.run(["dpkg", "--print-architecture"], stdout=subprocess.PIPE, text=True).stdout.strip()
OLD = "0.0.9"  # the package again, told to be of this version
BOTH = ("throwcal", "throwcald")


def skip(why: str) -> None:
    print("skipped:", why)
    sys.exit(77)


def run(*command, **more) -> str:
    done = subprocess.run(
        [str(word) for word in command], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, **more
    )
    assert done.returncode == 0, f"{command}: {done.returncode}\n{done.stdout[-3000:]}"
    return done.stdout


class Tree:
    """A small Debian in a folder."""

    def __init__(self, source: pathlib.Path, suite: str, folder: pathlib.Path):
        self.root = folder / "root"
        run(source / "deploy" / "mirror", suite, folder)
        from_mirror = (f"--aptopt={folder / 'apt.conf'}", "--aptopt=APT::Install-Recommends false")
        run("mmdebstrap", "--variant=apt", f"--architectures={ARCH}", *from_mirror, suite, self.root, folder / "sources.list")
        shutil.copy(folder / "apt.conf", self.root / "etc/apt/apt.conf.d/99mirror")

    def run(self, *command) -> str:
        script = 'mount --rbind /dev "$0/dev"; mount -t proc proc "$0/proc"; exec chroot "$0" env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin LC_ALL=C.UTF-8 "$@"'
        return run("unshare", "--mount", "sh", "-euc", script, self.root, *command)

    def apt(self, *command) -> str:
        """As somebody calls it who answers no questions: what is asked ends it."""
        return self.run("apt-get", "-y", "-q", *command)

    def dpkg(self, *command) -> str:
        return self.run("dpkg", *command)

    def files(self) -> dict[str, str]:
        """Every file that a purge is answerable for, and who it belongs to."""
        known = {}
        for path in sorted(self.root.rglob("*")):
            name = str(path.relative_to(self.root))
            if name.startswith(("proc/", "dev/", "var/lib/dpkg/", "var/cache/", "var/log/", "tmp/", "var/lib/apt/", "etc/.pwd.lock")):
                continue
            known[name] = f"{path.lstat().st_uid} {path.lstat().st_mode:o}"
        for name in ("etc/passwd", "etc/group", "etc/shadow", "etc/gshadow"):
            known[name] = "\n".join(sorted((self.root / name).read_text().splitlines()))
        return {name: is_so for name, is_so in known.items() if not name.endswith(("passwd-", "group-", "shadow-"))}


def older(package: pathlib.Path, folder: pathlib.Path) -> pathlib.Path:
    unpacked = folder / package.stem
    run("dpkg-deb", "-R", package, unpacked)
    control = unpacked / "DEBIAN" / "control"
    version = next(line for line in control.read_text().splitlines() if line.startswith("Version: ")).split()[1]
    control.write_text(control.read_text().replace(version, OLD))
    run("dpkg-deb", "--root-owner-group", "-b", unpacked, folder / f"{package.name.split('_')[0]}_{OLD}.deb")
    return folder / f"{package.name.split('_')[0]}_{OLD}.deb"


def difference(before: dict[str, str], after: dict[str, str]) -> list[str]:
    """Of each file that is not the same: its name, and the lines or the owner that only one of them has."""
    return sorted(
        f"{name}: {set(before.get(name, '').splitlines()) ^ set(after.get(name, '').splitlines())}"
        for name in before.keys() | after.keys()
        if before.get(name) != after.get(name)
    )


def packages_live_and_die(source: pathlib.Path, suite: str, folder: pathlib.Path) -> None:
    built = [
        pathlib.Path(line)
        for line in run(source / "deploy" / "package", "--suite", suite, "--arch", ARCH, "--output", folder / "built").split()
        if line.endswith(".deb")
    ]
    packages = {name: next(path for path in built if path.name.startswith(name + "_")) for name in BOTH}
    told = run("lintian", "--fail-on", "error,warning", *packages.values())
    print(f"{suite} {ARCH}: lintian: {told or 'nothing to say'}", end="")

    tree = Tree(source, suite, folder)
    put = tree.root / "put"
    put.mkdir()
    old = {name: older(path, folder) for name, path in packages.items()}
    for path in (*packages.values(), *old.values()):
        shutil.copy(path, put)
    new_names = [f"/put/{packages[name].name}" for name in BOTH]
    old_names = [f"/put/{old[name].name}" for name in BOTH]
    needed = [package for path in packages.values() for package in run("dpkg-deb", "-f", path, "Depends").split(",")]
    needed = [one.split("|")[0].split("(")[0].strip() for one in needed]
    tree.apt("update")
    tree.apt("install", *[one for one in needed if one and one not in BOTH], "man-db")
    clean = tree.files()

    tree.apt("install", new_names[0])
    assert "throwcal 0." in tree.run("throwcal", "--version") and not (tree.root / "usr/bin/throwcald").exists()
    tree.apt("purge", "throwcal")
    left = difference(clean, tree.files())
    assert not left, f"throwcal's purge leaves {left}"

    tree.apt("install", *old_names)
    state, etc = tree.root / "var/lib/throwcal", tree.root / "etc/throwcal"
    assert tree.run("id", "-nG", "throwcal").split()[:1] == ["throwcal"] and {"video", "input"} < set(tree.run("id", "-nG", "throwcal").split())
    assert tree.run("stat", "-c", "%U %a", "/var/lib/throwcal").split() == ["throwcal", "700"]
    assert tree.run("systemctl", "is-enabled", "throwcald").strip() == "enabled"
    assert "throwcald" in tree.run("man", "-w", "8", "throwcald") and tree.run("man", "-w", "throwcal") and tree.run("man", "-w", "throwcald.toml")
    (state / "sessions").mkdir()
    (state / "sessions/000001.throwcal").write_text("a session")
    (state / "token").write_text("a token\n")
    tree.run("throwcal", "simulate", "--output", "/etc/throwcal")
    (tree.root / "etc/default/throwcald").write_text('THROWCALD_OPTIONS="--listen 127.0.0.1:7710"\n')
    users = {
        path: path.read_bytes()
        for path in (state / "sessions/000001.throwcal", state / "token", etc / "rig.toml", tree.root / "etc/default/throwcald")
    }

    def are_kept(when: str) -> None:
        for path, content in users.items():
            assert path.read_bytes() == content, f"{when}: {path} is not what it was"

    tree.apt("install", *new_names)
    assert OLD not in tree.run("dpkg-query", "-W", *BOTH)
    are_kept("upgrade")
    tree.apt("remove", *BOTH)
    assert not (tree.root / "usr/bin/throwcald").exists() and not (tree.root / "usr/bin/throwcal").exists()
    are_kept("remove")
    tree.apt("install", *new_names)
    are_kept("installed again")
    tree.apt("purge", *BOTH)
    left = difference(clean, tree.files())
    assert not left, f"the purge leaves {left}"
    sizes = ", ".join(f"{path.name} {path.stat().st_size // 1024} KiB" for path in packages.values())
    print(f"{suite} {ARCH}: installed, upgraded from {OLD}, removed, installed, purged: nothing is left, nothing was asked; {sizes}", flush=True)


def main() -> None:
    source = pathlib.Path(sys.argv[sys.argv.index("--source") + 1]).resolve()
    if not os.environ.get("THROWCAL_LONG"):
        skip("takes long; THROWCAL_LONG=1 runs it")
    if os.getuid() != 0:
        skip("needs root")
    run(source / "deploy" / "install-dependencies", "mmdebstrap", "lintian")
    run(source / "deploy" / "emulate", ARCH)
    for suite in SUITES:
        with tempfile.TemporaryDirectory() as folder:
            packages_live_and_die(source, suite, pathlib.Path(folder))


if __name__ == "__main__":
    main()
