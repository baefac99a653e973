# SPDX-License-Identifier: BSD-3-Clause
"""What the project's plots share: one look, and files that are the same on every run."""
import csv

import matplotlib

matplotlib.use("svg")
matplotlib.rcParams.update({
    "svg.hashsalt": "throwcal", "svg.fonttype": "none", "font.family": "sans-serif", "font.size": 9,
    "axes.spines.top": False, "axes.spines.right": False, "axes.grid": True, "axes.axisbelow": True,
    "grid.color": "#e4e4e4", "grid.linewidth": 0.6, "lines.linewidth": 1.6, "lines.markersize": 4,
    "axes.edgecolor": "#555555", "xtick.color": "#333333", "ytick.color": "#333333",
    "axes.titlesize": 10, "axes.titlelocation": "left", "legend.frameon": False,
})
BLUE, ORANGE, GREEN, GREY = "#1f6fb4", "#d1661a", "#2c8a4b", "#8a8a8a"


def rows(path):
    """A CSV file's rows as dictionaries; numbers where they are such."""
    def value(text):
        try:
            return float(text)
        except ValueError:
            return text
    with open(path, newline="", encoding="utf-8") as file:
        return [{key: value(text) for key, text in row.items()} for row in csv.DictReader(file)]


def save(figure, path):
    """SVG (no date, so the same in gives the same out) on white; or whatever else the name says."""
    options = {"metadata": {"Date": None}} if path.endswith(".svg") else {"dpi": 110}
    figure.savefig(path, facecolor="white", **options)
