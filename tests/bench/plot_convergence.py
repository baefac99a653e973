#!/usr/bin/python3
# SPDX-License-Identifier: BSD-3-Clause
"""plot_convergence.py convergence.csv convergence.svg: RB-EKF alone from rough starts, sweep by sweep."""
import sys

import matplotlib.pyplot as plt
from matplotlib.ticker import FuncFormatter, PercentFormatter

from plots import BLUE, GREEN, GREY, ORANGE, rows, save


def main():
    source, target = sys.argv[1:]
    data = rows(source)
    figure, (error, share) = plt.subplots(1, 2, figsize=(7.6, 3.3), layout="constrained",
                                          width_ratios=(3, 2))
    for scene, colour in zip(dict.fromkeys(r["scene"] for r in data), (ORANGE, GREEN, GREY, BLUE)):
        points = [r for r in data if r["scene"] == scene]
        sweeps = [p["sweep"] for p in points]
        error.plot(sweeps, [p["median"] for p in points], "o-", color=colour, label=scene)
        error.fill_between(sweeps, [p["p10"] for p in points], [p["p90"] for p in points],
                           color=colour, alpha=0.15, linewidth=0)
        share.plot(sweeps, [p["converged"] for p in points], "o-", color=colour)
    error.axhline(1, color=GREY, linewidth=1, linestyle="--", label="joint refinement, rms")
    error.set_yscale("log")
    error.yaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
    error.set_xlabel("sweeps over all throws")
    error.set_ylabel("error / joint refinement's rms error")
    error.set_title("median, 10 % to 90 %")
    error.legend(loc="upper right")
    share.set_ylim(-0.02, 1.05)
    share.yaxis.set_major_formatter(PercentFormatter(1.0))
    share.set_xlabel("sweeps over all throws")
    share.set_title("starts within 3 times that")
    save(figure, target)


main()
