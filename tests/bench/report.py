#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""report.py BUILD [PART...]: runs what tests/bench built and prints compact tables; parts are rivals, filter, detector, growth
and convergence (all of them where none is named). Leaves growth.csv and convergence.csv in BUILD."""
import json
import re
import statistics
import subprocess
import sys
import tempfile

CASES = ("synchronised", "free_running")
CONTENDERS = (
    ("refine", "joint refinement with its covariance"),
    ("calibrate", "`full` from nothing"),
    ("ceres", "Ceres: solve and covariance"),
    ("ceres_solve", "Ceres: solve"),
    ("ceres_covariance", "Ceres: covariance"),
    ("ceres_build", "Ceres: building its problem"),
)


def output(command):
    return subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout


def instructions(command):
    """Inside measured(), by callgrind: the same on every run, however busy the machine."""
    with tempfile.TemporaryDirectory() as folder:
        log = subprocess.run(["valgrind", "--tool=callgrind", "--collect-atstart=no", "--toggle-collect=*measured*",
                              f"--callgrind-out-file={folder}/out", *command],
                             check=True, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True).stderr
    return int(re.search(r"Collected : (\d+)", log).group(1))


def times_ms(bench, repetitions, pattern):
    """One iteration's (processor time, time), [benchmark]: repetitions of all of them in random order."""
    with tempfile.NamedTemporaryFile(suffix=".json") as file:
        ran = subprocess.run([bench, f"--benchmark_filter={pattern}", f"--benchmark_repetitions={repetitions}",
                              "--benchmark_min_time=0.05", "--benchmark_enable_random_interleaving=true",
                              f"--benchmark_out={file.name}", "--benchmark_out_format=json"],
                             stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, check=False)
        if ran.returncode:
            sys.exit(ran.stderr)
        runs = json.load(file)["benchmarks"]
    out = {}
    for run in runs:
        if run["run_type"] == "iteration":
            out.setdefault(run["run_name"].split("/process_time")[0], []).append((run["cpu_time"], run["real_time"]))
    return out, [line for line in ran.stderr.splitlines() if " apart by" in line]


def rivals(build):
    times, agreement = times_ms(f"{build}/bench", 15, "synchronised|free_running")
    print("\n".join(agreement))
    for case in CASES:
        once = [f"{build}/bench_once", case]
        ceres = statistics.median(cpu for cpu, _ in times[f"{case}/ceres"])
        print(f"\n| {case.replace('_', '-')} | ms (quartiles) | Ceres / it | million instructions | MB |")
        print("|---|---|---|---|---|")
        for name, label in CONTENDERS:
            low, middle, high = statistics.quantiles((cpu for cpu, _ in times[f"{case}/{name}"]), n=4)
            ratio = f"{ceres / middle:.1f}" if name in ("refine", "calibrate", "ceres") else ""
            alone = name in ("refine", "calibrate", "ceres", "ceres_solve")
            count = f"{instructions([*once, name]) / 1e6:.1f}" if alone else ""
            memory = f"{float(output([*once, name])):.1f}" if alone else ""
            print(f"| {label} | {middle:.2f} ({low:.2f} to {high:.2f}) | {ratio} | {count} | {memory} |", flush=True)
    print("\n| Ceres' choices: ms by the clock | " + " | ".join(case.replace("_", "-") for case in CASES) + " |\n|---|---|---|")
    for name in dict.fromkeys(name.split("/")[2] for name in times if name.startswith("choice/")):
        cells = [f"{statistics.median(real for _, real in times[f'choice/{case}/{name}']):.1f}" for case in CASES]
        print(f"| {name.replace('_', ' ')} | " + " | ".join(cells) + " |")


def filter_steps(build):
    sample = [cpu for cpu, _ in times_ms(f"{build}/bench", 9, "1000")[0]["1000_throw_iterations"]]
    print(f"\n1000 throw iterations of 2 cameras x 30 frames: {statistics.median(sample):.1f} ms "
          f"({min(sample):.1f} to {max(sample):.1f})")
    print("\n| instructions a step (predict and update) | 2 cameras | 4 | 8 |\n|---|---|---|---|")
    for words in ([], ["offsets"], ["offsets", "drag"]):
        cells = []
        for cameras in ("2", "4", "8"):
            command = [f"{build}/filter_steps", cameras, *words]
            cells.append(f"{instructions(command) / int(output(command)):.0f}")
        print(f"| {' and '.join(words) or 'poses alone'} | " + " | ".join(cells) + " |", flush=True)


def detector(build):
    print(output([f"{build}/detector_speed"]), flush=True)


def growth(build):
    points = [("throws", 8, n) for n in (5, 10, 20, 50, 100)] + [("cameras", n, 10) for n in (2, 4, 8, 16, 32, 64)]
    points.append(("both", 64, 50))
    with open(f"{build}/growth.csv", "w", encoding="utf-8") as file:
        file.write("series,cameras,throws,sightings,seconds,before_mb,most_mb\n")
        print("\n| cameras | throws | sightings | processor time, s | MB at most (the recording alone) |\n|---|---|---|---|---|")
        for series, cameras, throws in points:
            row = output([f"{build}/growth", str(cameras), str(throws)]).strip()
            file.write(f"{series},{row}\n")
            _, _, sightings, seconds, before, most = row.split(",")
            print(f"| {cameras} | {throws} | {sightings} | {float(seconds):.3g} | {most} ({before}) |", flush=True)


def convergence(build):
    table = output([f"{build}/convergence"])
    with open(f"{build}/convergence.csv", "w", encoding="utf-8") as file:
        file.write(table)


PARTS = {"rivals": rivals, "filter": filter_steps, "detector": detector, "growth": growth, "convergence": convergence}

if len(sys.argv) < 2 or not set(sys.argv[2:]) <= set(PARTS):
    sys.exit(f"usage: report.py BUILD [{'|'.join(PARTS)}]...")
for part in sys.argv[2:] or PARTS:
    PARTS[part](sys.argv[1])
