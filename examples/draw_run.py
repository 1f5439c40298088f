# SPDX-License-Identifier: Apache-2.0
"""Speed, top gap and height of a recorded run as a picture: python examples/draw_run.py BAG PICTURE.svg"""

import sys

from matplotlib import rc_context
from matplotlib.figure import Figure

from inductrack_ros.data import read_bag

PANELS = (("surge_rate", 1.0, "speed (m/s)"), ("surge", 1.0, "travel (m)"), ("heave", 1e3, "heave (mm)"))


def draw(bag: str, picture: str) -> None:
    """Three panels over time."""
    run = read_bag(bag)
    figure = Figure(figsize=(7.2, 5.2), layout="constrained")
    for axes, (channel, factor, label) in zip(figure.subplots(3, sharex=True), PANELS, strict=True):
        times, values = run.samples(channel)
        axes.plot(times, factor * values, linewidth=1.2)
        axes.set_ylabel(label)
        axes.grid(color="0.9")
    axes.set_xlabel("time (s)")
    with rc_context({"svg.fonttype": "none", "svg.hashsalt": "run"}):
        figure.savefig(picture, metadata={"Date": None})


if __name__ == "__main__":
    draw(*sys.argv[1:])
