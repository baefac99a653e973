#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""The man pages tell what the programs have, no more and no less; completion offers it."""

import os
import pathlib
import re
import shlex
import shutil
import subprocess
import sys
import typing

import box

HEADING = re.compile(r"^([A-Za-z]+):$")
OPTION = re.compile(r"^ +(?:-\w, *)?--([a-z-]+)(?: ([A-Z]{2,}\S*))?(.*)$")
SUBCOMMAND = re.compile(r"^ +([a-z][a-z-]*)")
RANGE = re.compile(r" in \[(\S+) - (\S+)\]")
DEFAULT = re.compile(r"^(?:\S*|.* in \[[^]]*\])=(\S+)|^[A-Z]\S*(?: in \[[^]]*\])? \[(\S+)\]")  # CLI11 of Debian 12, of Debian 13
NUMBER = re.compile(r"(?<![\w.])\d+(?:\.\d+)?(?:e[+-]?\d+)?(?![\w])")
MACRO = re.compile(r"^[A-Z][a-z]$")


class Option(typing.NamedTuple):
    takes_value: bool
    tells: list[str]  # its default and the ends of its range


class Item(typing.NamedTuple):
    has_argument: bool
    text: str


def help_of(program: pathlib.Path, *command: str) -> str:
    return subprocess.run([program, *command, "--help"], capture_output=True, text=True, check=True, timeout=box.PATIENCE_S).stdout


def understood(text: str) -> tuple[dict[str, Option], list[str]]:
    """The options and the subcommands that a --help prints."""
    options, commands, section = {}, [], ""
    for line in text.splitlines():
        if heading := HEADING.match(line):
            section = heading[1].lower()
        elif not line:
            section = ""
        elif section == "options" and (match := OPTION.match(line)):
            name, kind, rest = match.groups()
            default, ends = kind and DEFAULT.match(kind + rest), kind and RANGE.search(kind + rest)
            options[name] = Option(kind is not None, ([default[1] or default[2]] if default else []) + (list(ends.groups()) if ends else []))
        elif section == "subcommands" and (match := SUBCOMMAND.match(line)):
            commands.append(match[1])
    return options, commands


def every_help(program: pathlib.Path) -> dict[str, dict[str, Option]]:
    """The options of each command by its name, "" for the program's own."""
    out, to_ask = {}, [()]
    while to_ask:
        command = to_ask.pop()
        out[" ".join(command)], below = understood(help_of(program, *command))
        to_ask += [(*command, name) for name in below]
    return out


def sections(page: str) -> dict[str, list[str]]:
    """The lines of a page (mdoc) by their heading; a command's without its arguments."""
    out, here = {}, []
    for line in page.splitlines():
        if line.startswith((".Sh ", ".Ss ")):
            here = out.setdefault(line[4:].split(" Ar ")[0], [])
        here.append(line)
    return out


def flags(line: str) -> list[str]:
    """The long options in a line of macros."""
    out, is_flag = [], False
    for word in line.lstrip(".").split() if line.startswith(".") else []:
        is_flag = word == "Fl" if MACRO.match(word) else is_flag
        out += [word[1:]] if is_flag and word.startswith("-") else []
    return out


def items(lines: list[str], macro: str) -> dict[str, Item]:
    """What a list explains: of "Fl" by the option, of "Li" by the key."""
    out, names = {}, []
    for line in lines:
        if line.startswith(".It "):
            names = flags(line) if macro == "Fl" else line.split()[2:]
            out |= {name: Item(" Ar " in line, "") for name in names}
        elif line.startswith(".El"):
            names = []
        elif names:
            out |= {name: out[name]._replace(text=f"{out[name].text} {line}") for name in names}
    return out


def taken(lines: list[str]) -> list[str]:
    """Of "Takes" and the line behind it: what is explained once, for every command of the box."""
    return [flag for word, line in zip(lines, lines[1:]) if word == "Takes" for flag in flags(line)]


def not_told(option: Option, item: Item) -> list[str]:
    """What an item says otherwise than --help, or not."""
    numbers = {float(number) for number in NUMBER.findall(item.text)}
    words = {word.rstrip(".,;") for word in item.text.split()}
    wrong = [] if option.takes_value == item.has_argument else ["an argument" if option.takes_value else "no argument"]
    return wrong + [told for told in option.tells if (float(told) not in numbers if NUMBER.fullmatch(told) else told not in words)]


def differences(page: str, helps: dict[str, dict[str, Option]]) -> list[str]:
    """Where a program's page and what its --help prints are not of one opinion."""
    out, parts = [], sections(page)
    shared = items(parts.get("Options of the box", []), "Fl")
    for command, options in helps.items():
        if command not in parts and command:
            out.append(f"{command}: has no section")
            continue
        lines = parts[command] if command else parts["OPTIONS" if "OPTIONS" in parts else "DESCRIPTION"]
        told = items(lines, "Fl")
        if command:  # --help is explained once; an option of the box at the end
            options = {name: option for name, option in options.items() if name != "help"}
            told |= {name: shared.get(name, Item(False, "")) for name in taken(lines)}
        out += [f"{command} --{name}: is not in the page" for name in options.keys() - told.keys()]
        out += [f"{command} --{name}: the program has it not" for name in told.keys() - options.keys()]
        for name in options.keys() & told.keys():
            item = told[name] if command else told[name]._replace(text=told[name].text + shared.get(name, Item(False, "")).text)
            out += [f"{command} --{name}: {wrong} is not told" for wrong in not_told(options[name], item)]
    known = {name for options in helps.values() for name in options}
    out += [f"--{name}: no --help has it" for line in page.splitlines() for name in flags(line) if name not in known]
    commands = {line[4:].split(" Ar ")[0] for line in page.splitlines() if line.startswith(".Ss ")} - {"Options of the box"}
    return out + [f"{command}: no such command" for command in sorted(commands - helps.keys())]


def toml_keys(text: str) -> dict[str, dict[str, str]]:
    """Of a rig file: each table's keys and what it gives them, those that are commented out, too."""
    out, here = {}, {}
    for line in text.splitlines():
        if table := re.match(r"^(\[+\w+\]+)$", line):
            here = out.setdefault(table[1], {})
        elif key := re.match(r"^#?(\w+) = ([^#]*?)\s*(?:#.*)?$", line):
            here.setdefault(key[1], key[2])
    return out


def toml_differences(page: str, rig_file: str) -> list[str]:
    out, keys = [], toml_keys(rig_file)
    told = {heading: items(lines, "Li") for heading, lines in sections(page).items() if heading.startswith("[")}
    out += [f"{table}: is on one side only" for table in keys.keys() ^ told.keys()]
    for table in keys.keys() & told.keys():
        out += [f"{table} {key}: is not in the page" for key in keys[table].keys() - told[table].keys()]
        out += [f"{table} {key}: is not in the rig file" for key in told[table].keys() - keys[table].keys()]
        out += [f"{table} {key}: has no default" for key, item in told[table].items() if not re.search(r"\[|\.Bq ", item.text)]
    for key, value in keys["[simulation]"].items():  # where the rig file has every default
        numbers = re.findall(r"\[([\d.]+)\]", told["[simulation]"].get(key, Item(False, "")).text)
        if key != "cameras" and [float(number) for number in numbers] != [float(value)]:
            out.append(f"[simulation] {key}: its default is {value}")
    return out


def complete(completion: pathlib.Path, folder: pathlib.Path, *words: str, before: str = "") -> list[str]:
    """What bash offers for the last word; the words as readline would part them."""
    script = f"""{before}
        source "$1"; shift
        how=$(complete -p "${{1##*/}}"); how=${{how#* -F }}
        COMP_WORDS=("$@") COMP_CWORD=$(($# - 1))
        "${{how%% *}}" "$1" "${{@: -1}}" "${{@: -2:1}}"
        for reply in ${{COMPREPLY[@]+"${{COMPREPLY[@]}}"}}; do printf '%s\\n' "$reply"; done"""
    path = f"{folder / 'bin'}:{os.environ['PATH']}"
    run = subprocess.run(["bash", "--norc", "--noprofile", "-c", script, "bash", completion, *words], cwd=folder / "here", text=True,
                         capture_output=True, env={**os.environ, "PATH": path, "HOME": str(folder / "home")}, timeout=box.PATIENCE_S)  # fmt: skip
    assert run.returncode == 0 and run.stderr == "", (words, run)
    return run.stdout.splitlines()


def counted_programs(build: pathlib.Path, folder: pathlib.Path) -> pathlib.Path:
    """Both programs in folder/bin; the file that gets a line whenever one is called."""
    calls = folder / "calls"
    for name in ("throwcal", "throwcald"):
        program = folder / "bin" / name
        program.write_text(f'#!/bin/sh\necho "$*" >> {shlex.quote(str(calls))}\nexec {shlex.quote(str(build / name))} "$@"\n')
        program.chmod(0o755)
    return calls


def check_completion(completion: pathlib.Path, build: pathlib.Path, folder: pathlib.Path, helps: dict[str, dict[str, Option]]) -> None:
    for name in ("bin", "here/films", "home"):
        (folder / name).mkdir(parents=True)
    for name in ("here/my sightings.csv", "here/it's.csv", "here/films/north.mkv", "home/rig.toml"):
        (folder / name).write_text("")
    calls = counted_programs(build, folder)
    method, video, odd = ("calibrate", "--method"), ("calibrate", "--video"), "set -u; shopt -s failglob; IFS=:"
    cases = (
        (("throwcal", "cal"), ["calibrate"]),
        (("throwcal", "calibrate", "--me"), ["--method"]),
        (("throwcal", *method, "r"), ["rb-ekf", "r-ekf"]),
        (("throwcal", *method, "=", "r"), ["rb-ekf", "r-ekf"]),
        (("throwcal", "calibrate", "--method=r"), ["--method=rb-ekf", "--method=r-ekf"]),
        (("throwcal", "calibrate", "--throw-iterations", ""), []),
        (("throwcald", "--li"), ["--listen"]),
        (("throwcal", "capture", "sta"), ["start"]),
        (("throwcal", "capture", "start", "--until"), ["--until-stopped"]),
        (("throwcal", "--can", "vcan", "status", "--ho"), ["--host"]),
        (("throwcal", "calibrate", "--sightings", "my"), ["my sightings.csv"]),
        (("throwcal", "calibrate", "--sightings", "my\\ si"), ["my sightings.csv"]),
        (("throwcal", "calibrate", "--sightings", '"my si'), ["my sightings.csv"]),
        (("throwcal", "calibrate", "--sightings", "it\\'"), ["it's.csv"]),
        (("throwcald", "--config", "~/ri"), ["~/rig.toml"]),
        (("throwcal", *video, "no"), []),
        (("throwcal", *video, "north", "=", "films/n"), ["films/north.mkv"]),
        (("throwcal", *video, "a=b", "north=films/n"), ["north=films/north.mkv"]),
        (("throwcal", "detect", "fil"), ["films"]),
        (("throwcal", "delete", "7", ""), []),
        (("throwcal", "snapshot", "--source", "v4l2", ":", "/dev/nul"), ["/dev/null"]),
        (("throwcal", "nothing", "--such"), []),
        (("nowhere/throwcal", "cal"), []),
    )  # fmt: skip
    for before, some in (("", cases), (odd, cases[::4])):
        for words, expected in some:
            calls.write_text("")
            offered = complete(completion, folder, *words, before=before)
            assert offered == expected, (words, offered)
            asked = calls.read_text().splitlines()
            assert all(call.split()[-1] == "--help" for call in asked) and len(asked) == (words[0] != "nowhere/throwcal"), (words, asked)
    for command, options in helps.items():
        offered = complete(completion, folder, "throwcal", *command.split(), "-")
        assert offered == [f"--{name}" for name in options], (command, offered)
    assert sorted(complete(completion, folder, "throwcal", "")) == sorted(command for command in helps if command and " " not in command)
    # It takes a word behind an option before the command for its value; and it knows of some options that they are no paths.
    assert all(option.takes_value for name, option in helps[""].items() if name not in ("help", "version")), helps[""]
    by_name = set(re.findall(r"--([a-z][a-z-]+)(?= \||\))", completion.read_text()))
    daemon = understood(help_of(build / "throwcald"))[0]
    assert by_name and by_name <= {*daemon, *(name for options in helps.values() for name in options)}, by_name
    newer = folder / "bin" / "throwcal"
    newer.write_text("#!/bin/sh\nprintf 'OPTIONS:\\n  -h,     --help    Help\\n          --colour TEXT:{red,blue} [red]  Which\\n'\n")
    assert complete(completion, folder, "throwcal", "--") == ["--help", "--colour"], "those of a program that comes later"
    assert complete(completion, folder, "throwcal", "--colour", "b") == ["blue"]


def proves_itself(page: str, helps: dict[str, dict[str, Option]], toml_page: str, rig_file: str) -> None:
    """A check that cannot fail is none: each lack once."""
    of_debian_13 = "Options:\n  --n INT:INT in [1 - 9] [3]      How many\n  --m TEXT:{a,b} [a]\n  --unit INT:INT in [0 - 11]  Which ([can])\n"
    expected = {"n": Option(True, ["3", "1", "9"]), "m": Option(True, ["a"]), "unit": Option(True, ["0", "11"])}
    assert understood(of_debian_13)[0] == expected, understood(of_debian_13)
    for old, new, expected in (
        (".It Fl -guess Ar FILE\n", "", "calibrate --guess: is not in the page"),
        (".It Fl -guess Ar FILE\n", ".It Fl -guess\n", "calibrate --guess: an argument is not told"),
        (".It Fl -yes\n", ".It Fl -yes Ar FILE\n", "delete --yes: no argument is not told"),
        (".It Fl -yes\n", ".It Fl -yes\n.It Fl -no\n", "--no: no --help has it"),
        (".It Fl -yes\n", ".It Fl -yes\n.It Fl -output Ar FILE\n", "delete --output: the program has it not"),
        ("default 30, 1 to 100000", "default 31, 1 to 100000", "calibrate --throw-iterations: 30 is not told"),
        ("default 30, 1 to 100000", "default 30, 1 to 10000", "calibrate --throw-iterations: 100000 is not told"),
        ("default 127.0.0.1:7710", "default box", "status --host: 127.0.0.1:7710 is not told"),
        (".Ss watch\n", ".Ss watches\n", "watch: has no section"),
        (".Ss watch\n", ".Ss watches\n", "watches: no such command"),
        ("Takes\n.Fl -host , -can , -unit , -json\nand", "Takes\n.Fl -host , -unit , -json\nand", "fetch --can: is not in the page"),
    ):  # fmt: skip
        changed = page.replace(old, new)
        assert changed != page and expected in differences(changed, helps), (expected, differences(changed, helps))
    for changed, file, expected in (
        (toml_page.replace(".It Li grab\n", ""), rig_file, "[button] grab: is not in the page"),
        (toml_page, rig_file.replace("#grab = ", "#grasp = "), "[button] grab: is not in the rig file"),
        (toml_page.replace("[half of the machine's]", ""), rig_file, "[daemon] frame_memory_mb: has no default"),
        (toml_page, rig_file.replace("#side_m = 6.0", "#side_m = 7.0"), "[simulation] side_m: its default is 7.0"),
        (toml_page.replace(".Ss [can]\n", ""), rig_file, "[can]: is on one side only"),
    ):  # fmt: skip
        assert expected in toml_differences(changed, file), (expected, toml_differences(changed, file))


def check_layout(pages: list[pathlib.Path], completion: pathlib.Path) -> None:
    """By the programs that read them, where they are there."""
    for page in pages:
        assert page.read_text().startswith('.\\" SPDX-License-Identifier: BSD-3-Clause\n'), page
    english = {**os.environ, "LC_ALL": "C.UTF-8"}
    for command in (
        ["mandoc", "-T", "lint", "-W", "warning", *pages],
        ["groff", "-mandoc", "-Tutf8", "-ww", "-z", *pages],
        ["shellcheck", completion],
    ):
        if not shutil.which(command[0]):
            print(f"{command[0]}: not here, not asked")
            continue
        run = subprocess.run(command, capture_output=True, text=True, env=english, timeout=box.PATIENCE_S)
        assert run.returncode == 0 and run.stdout + run.stderr == "", (command[0], run.stdout, run.stderr)
        print(f"{command[0]}: no warning")


def story(build: pathlib.Path, folder: pathlib.Path) -> None:
    source = pathlib.Path(sys.argv[sys.argv.index("--source") + 1]).resolve()
    pages = [source / "deploy" / "man" / name for name in ("throwcal.1", "throwcald.8", "throwcald.toml.5")]
    client, daemon, toml_page = (page.read_text() for page in pages)
    rig_file = (source / "firmware" / "throwcald.toml").read_text()
    helps = every_help(build / "throwcal")
    daemon_help = every_help(build / "throwcald")
    assert len(helps) > 15 and len(helps["calibrate"]) > 8 and helps["calibrate"]["method"] == Option(True, ["full"]), helps
    wrong = differences(client, helps) + differences(daemon, daemon_help) + toml_differences(toml_page, rig_file)
    assert not wrong, "\n".join(wrong)
    proves_itself(client, helps, toml_page, rig_file)
    told = sum(map(len, helps.values())) + len(daemon_help[""])
    print(f"{len(helps) - 1} commands, {told} options, {sum(map(len, toml_keys(rig_file).values()))} keys: the pages have them")
    completion = source / "deploy" / "completion" / "throwcal"
    check_layout(pages, completion)
    check_completion(completion, build, folder, helps)
    print("completion offers them")


if __name__ == "__main__":
    box.main(story)
