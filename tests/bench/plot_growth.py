#!/usr/bin/python3
# SPDX-License-Identifier: BSD-3-Clause
"""plot_growth.py growth.csv growth.svg: time and memory of the whole method against how much there is."""
import sys

import matplotlib.pyplot as plt
from matplotlib.ticker import FuncFormatter, LogLocator

from plots import BLUE, GREY, ORANGE, rows, save


def line(axes, points, x, y, colour, label):
    points = sorted(points, key=lambda p: p[x])
    axes.plot([p[x] for p in points], [p[y] for p in points], "o-", color=colour, label=label)
    return points


def guide(axes, points, x, y):
    """A line of slope 1 below the curve."""
    first, last = points[0], points[-1]
    axes.plot([first[x], last[x]], [0.6 * first[y], 0.6 * first[y] * last[x] / first[x]], "--", color=GREY, linewidth=1,
              label="slope 1")


def main():
    source, target = sys.argv[1:]
    data = rows(source)
    by_throws = [r for r in data if r["series"] == "throws"]
    by_cameras = [r for r in data if r["series"] == "cameras"]
    figure, grid = plt.subplots(2, 2, figsize=(7.6, 5.2), sharex="col", sharey="row",
                                layout="constrained")
    for column, (points, x, colour, title) in enumerate((
            (by_throws, "throws", BLUE, "8 cameras"), (by_cameras, "cameras", ORANGE, "10 throws"))):
        time, memory = grid[0][column], grid[1][column]
        ordered = line(time, points, x, "seconds", colour, "measured")
        guide(time, ordered, x, "seconds")
        line(memory, points, x, "most_mb", colour, "at its most")
        line(memory, points, x, "before_mb", GREY, "the recording alone")
        time.set_title(title)
        memory.set_xlabel(x)
        for axes in (time, memory):
            axes.set_xscale("log", base=2)
            axes.set_yscale("log")
            axes.set_xticks([p[x] for p in ordered])
            axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
            axes.minorticks_off()
            axes.xaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
            axes.yaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
            axes.legend(loc="upper left")
    grid[0][0].set_ylabel("processor time, s")
    grid[1][0].set_ylabel("resident memory, MB")
    save(figure, target)


main()
