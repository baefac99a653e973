#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Draw what `throwcal calibrate` made of a recording: a column a camera, its picture above, its residuals below.

throwcal calibrate --rig rig.toml --sightings s.csv --output c.json --residuals r.csv
awk -F, 'NR==1 || ($6==1 && $5!=5)' r.csv > without.csv      # the same flights, throw 5 left out
throwcal calibrate --rig rig.toml --sightings without.csv --output c2.json --residuals r2.csv
plot_flights.py rig.toml s.csv c.json r.csv --second r2.csv --second-name "without throw 5" --output flights.svg
"""

import argparse
import csv
import json
import pathlib
import re
import tomllib
from collections import defaultdict

import matplotlib

matplotlib.rcParams.update({"svg.fonttype": "none", "svg.hashsalt": "throwcal", "font.size": 9, "path.simplify": False})
import matplotlib.pyplot as plt  # noqa: E402
from matplotlib.patches import Rectangle  # noqa: E402

COLOURS = ["#0072b2", "#e69f00", "#009e73", "#56b4e9", "#d62728", "#cc79a7", "#7a5c00", "#5e3c99"]
GAP_S, GAP_PX, MARGIN = 0.05, 120.0, 0.1  # where a track is cut; how much is drawn beyond the picture's edge


def sightings(path):
    """Camera -> its rows in the order of time."""
    cameras = defaultdict(list)
    with open(path, newline="", encoding="utf-8") as file:
        for row in csv.DictReader(file):
            cameras[row["camera"]].append((float(row["time_s"]), float(row["u_px"]), float(row["v_px"])))
    return {name: sorted(rows) for name, rows in cameras.items()}


def residuals(path):
    """(camera, time in microseconds) -> (throw, length of the residual in px), of the used sightings."""
    found = {}
    with open(path, newline="", encoding="utf-8") as file:
        for row in csv.DictReader(file):
            if row["used"] == "1":
                length = (float(row["residual_u_px"]) ** 2 + float(row["residual_v_px"]) ** 2) ** 0.5
                found[row["camera"], round(float(row["time_s"]) * 1e6)] = (row["throw"], length)
    return found


def tracks(rows):
    """Rows cut where the ball was not seen for a while or jumped."""
    cuts = [
        i
        for i, (a, b) in enumerate(zip(rows, rows[1:]), 1)
        if b[0] - a[0] > GAP_S or max(abs(b[1] - a[1]), abs(b[2] - a[2])) > GAP_PX
    ]
    return [rows[i:j] for i, j in zip([0, *cuts], [*cuts, len(rows)])]


def draw_picture(axes, camera, rows, used, colours):
    width, height = camera["width_px"], camera["height_px"]
    axes.add_patch(Rectangle((0, 0), width, height, facecolor="#f7f7f7", edgecolor="#888888", linewidth=0.8))
    for track in tracks(rows):
        axes.plot([r[1] for r in track], [r[2] for r in track], color="#bbbbbb", linewidth=1, zorder=1)
    flights = defaultdict(list)
    for row in rows:
        if (camera["name"], round(row[0] * 1e6)) in used:
            flights[used[camera["name"], round(row[0] * 1e6)][0]].append(row)
    for i, (throw, flight) in enumerate(flights.items()):
        axes.plot([r[1] for r in flight], [r[2] for r in flight], color=colours[throw], linewidth=2.2, zorder=2)
        _, u, v = flight[len(flight) * (2 * i + 1) // (2 * len(flights))]  # each at another place along its flight
        axes.annotate(
            throw,
            (u, v),
            (0, -32 if i % 2 else 22),
            textcoords="offset points",
            color=colours[throw],
            weight="bold",
            ha="center",
            arrowprops={"arrowstyle": "-", "color": colours[throw], "linewidth": 0.6, "shrinkA": 0, "shrinkB": 1},
        )
    axes.set(
        xlim=(-MARGIN * width, (1 + MARGIN) * width), ylim=((1 + MARGIN) * height, -MARGIN * height), aspect="equal"
    )
    beyond = sum(not (0 <= u < width and 0 <= v < height) for _, u, v in rows)
    axes.set_title(
        f"{camera['name']}: {len(rows)} sightings, {sum(map(len, flights.values()))} in flights, {beyond} outside the picture",
        fontsize=9,
    )


def draw_residuals(axes, name, used, second, colours):
    """Flights one after another, each as long as it has sightings."""
    start = 0
    for throw in colours:
        times = sorted(time for camera, time in used if camera == name and used[camera, time][0] == throw)
        for source, style in (
            (used, {"color": colours[throw], "linewidth": 1.8}),
            (second, {"color": "black", "linewidth": 0.8}),
        ):
            points = [(start + i, max(source[name, t][1], 0.05)) for i, t in enumerate(times) if (name, t) in source]
            axes.plot([p[0] for p in points], [p[1] for p in points], **style)
        if times:
            axes.text(start + len(times) / 2, 75, throw, color=colours[throw], weight="bold", ha="center", va="center")
            start += len(times) + 4
    axes.set(
        yscale="log",
        ylim=(0.05, 120),
        xlabel="sighting, flight after flight",
        yticks=[0.1, 1, 10, 100],
        yticklabels=["0.1", "1", "10", "100"],
    )
    axes.minorticks_off()
    axes.grid(axis="y", color="#dddddd", linewidth=0.5)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name in ("rig", "sightings", "calibration", "residuals"):
        parser.add_argument(name)
    parser.add_argument("--second", help="residuals of another calibration of the same sightings, in black")
    parser.add_argument("--second-name", default="second")
    parser.add_argument("--output", required=True, help="SVG, or any format matplotlib writes")
    options = parser.parse_args()
    cameras = tomllib.loads(pathlib.Path(options.rig).read_text(encoding="utf-8"))["camera"]
    calibration = json.loads(pathlib.Path(options.calibration).read_text(encoding="utf-8"))
    rows, used, second = (
        sightings(options.sightings),
        residuals(options.residuals),
        residuals(options.second) if options.second else {},
    )
    colours = {throw["id"]: COLOURS[i % len(COLOURS)] for i, throw in enumerate(calibration["throws"])}
    figure, axes = plt.subplots(
        2, len(cameras), figsize=(4.4 * len(cameras), 5.4), squeeze=False, layout="constrained", height_ratios=[1.25, 1]
    )
    for column, (camera, result) in enumerate(zip(cameras, calibration["cameras"])):
        draw_picture(axes[0][column], camera, rows.get(camera["name"], []), used, colours)
        draw_residuals(axes[1][column], camera["name"], used, second, colours)
        rms = [r[1] for (name, _), r in second.items() if name == camera["name"]]
        black = f"; black: {(sum(r * r for r in rms) / 2 / len(rms)) ** 0.5:.2f} px" if rms else ""
        axes[1][column].set_title(f"rms {result['reprojection_rms_px'] or float('nan'):.2f} px{black}", fontsize=9)
    axes[0][0].set_ylabel("picture (px)")
    axes[1][0].set_ylabel("length of the residual (px)")
    black = f"; black: {options.second_name}" if second else ""
    figure.suptitle(f"{len(colours)} throws, verdict: {calibration['verdict']}. Colour: flights; grey: not used{black}")
    figure.savefig(options.output, dpi=110, metadata={"Date": None} if options.output.endswith(".svg") else None)
    if options.output.endswith(".svg"):  # a tenth of a point is enough
        drawing = pathlib.Path(options.output)
        text = re.sub(
            r'(?<= d=")[^"]+',
            lambda path: re.sub(r"(\.\d)\d+", r"\1", path[0]).replace(" \nL ", " "),
            drawing.read_text(encoding="utf-8"),
        )
        drawing.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
