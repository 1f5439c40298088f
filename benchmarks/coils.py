# SPDX-License-Identifier: Apache-2.0
"""What averaging costs: a track of single coils against the averaged law, from 5 to 40 m/s.

python benchmarks/coils.py                          prints the tables of docs/coils.md
python benchmarks/coils.py --draw docs/coils.svg    and draws its figure (matplotlib: make benchmark installs it)
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
from scipy.optimize import brentq

from inductrack_ros.core.coils.averages import heave_motion, lift_of, mean_forces, ripple
from inductrack_ros.core.model import Model
from inductrack_ros.paper.stability import corner_speed, modes

SPEEDS = (10.0, 12.0, 13.3, 15.5, 20.0, 25.0, 30.0, 40.0)
ALL_SPEEDS = (5.0, 7.5, *SPEEDS)
#: Heave at which forces are compared (m): a top gap of 5.5 mm.
HEAVE = -0.0045
#: Long arrays: front and rear set abut, so that 2 × 20 wavelengths have two ends.
LENGTHS = (1, 2, 5, 10, 20)
_FORCES = ("repulsion_top", "repulsion_right", "repulsion_left", "magnetic_drag")


def coils(wavelengths: float = 1.0, **options: object) -> Model:
    """The paper's rig over single coils; the cradle is as many times heavier as its arrays are longer."""
    spacing = max(0.55, 0.1 * wavelengths)
    options = {"array_wavelengths": wavelengths, "array_spacing": spacing, **options}
    return Model.create({"mass": 9.3 * wavelengths}, track="coils", coil_options=options)


def averaged_forces(speed: float) -> np.ndarray:
    """Repulsions and drag (N) of (36), (38)."""
    q = Model.default().quantities(np.array([0.0, 0.0, HEAVE, 0.0, speed, 0.0, 0.0, 0.0]))
    return np.array([q[name] for name in _FORCES])


def forces_table() -> list[dict[str, float]]:
    """Mean forces over the averaged law's, and ripple over the mean, by speed."""
    rows, short, long = [], coils(), coils(20.0)
    for speed in ALL_SPEEDS:
        law, one, many = averaged_forces(speed), mean_forces(short, speed, HEAVE), mean_forces(long, speed, HEAVE) / 20
        swing = ripple(short, speed, HEAVE)
        rows.append(
            {
                "speed": speed,
                "lift": lift_of(one) / lift_of(law),
                "drag": one[3] / law[3],
                "long lift": lift_of(many) / lift_of(law),
                "long drag": many[3] / law[3],
                "lift ripple, ppm": 1e6 * swing[0] / lift_of(one),
                "drag ripple, ppm": 1e6 * swing[1] / one[3],
            }
        )
    return rows


def heave_table() -> list[dict[str, float]]:
    """Equilibrium gap and heave damping, by speed: averaged law, `coil_current_dynamics`, coils."""
    rows, short, long, law = [], coils(), coils(20.0), Model.default()
    for speed in SPEEDS:
        linear, one, many = modes(law, speed), heave_motion(short, speed), heave_motion(long, speed)
        rows.append(
            {
                "speed": speed,
                "gap": 1e3 * linear.gap,
                "coils gap": 1e3 * (short.equilibrium_heave(speed) + 0.010),
                "held": linear.held_damping,
                "effect": linear.current_damping,
                "long": many.damping / 20,
                "coils": one.damping,
            }
        )
    return rows


def ends_table() -> list[dict[str, float]]:
    """Lift and drag over the averaged law's at 20 m/s by the length of each set."""
    law, rows = averaged_forces(20.0), []
    for n in LENGTHS:
        found = mean_forces(coils(float(n)), 20.0, HEAVE) / n / law
        rows.append({"wavelengths": n, "top": found[0], "side": found[1], "drag": found[3]})
    return rows


def sign_change(model: Model) -> float:
    """Speed (m/s) at which the coils' heave damping changes its sign."""
    return brentq(lambda v: heave_motion(model, v).damping, 10.0, 16.0, xtol=0.02)


def failed_coil() -> tuple[float, float]:
    """Largest share of lift that one failed coil takes at 20 m/s, and what it does to a free cradle's heave (m)."""
    whole, broken = coils(), coils(failed_coils=[400])
    start, times = whole.initial_state(surge_rate=20.0), np.arange(1501) * 2e-4
    runs = [m.simulate(times, start, 0.0) for m in (whole, broken)]
    lift = [r["heave_acceleration"] * 9.3 for r in runs]
    return np.max(np.abs(lift[1] - lift[0])) / (9.3 * 9.81), np.max(np.abs(runs[1]["heave"] - runs[0]["heave"]))


def pace(model: Model) -> float:
    """Simulated seconds to a second of one core, at 40 m/s, 4 degrees of freedom."""
    start = model.initial_state(surge_rate=40.0, sway=1e-3)
    model.simulate(np.arange(2) * 1e-3, start)
    best = np.inf
    for _ in range(3):
        begun = time.process_time()
        model.simulate(np.arange(501) * 2e-3, start, 5000.0)
        best = min(best, time.process_time() - begun)
    return 1.0 / best


def draw(path: Path, forces: list[dict[str, float]], heave: list[dict[str, float]]) -> None:
    """Lift and drag over the averaged law's, and damping, over speed."""
    import matplotlib

    matplotlib.use("svg")
    import matplotlib.pyplot as plt

    plt.rcParams.update({"font.size": 9, "svg.hashsalt": "coils", "axes.grid": True, "grid.alpha": 0.3})
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.4), layout="constrained")
    _curves(
        left,
        forces,
        (
            ("lift", "C0o-", "lift, arrays of one wavelength"),
            ("drag", "C3o-", "drag, arrays of one wavelength"),
            ("long lift", "C0:", "lift, long arrays"),
            ("long drag", "C3:", "drag, long arrays"),
        ),
    )
    left.set(xlabel="speed, m/s", ylabel="single coils over averaged law", ylim=(0.7, 1.15))
    _curves(
        right,
        heave,
        (
            ("coils", "C0o-", "coils, arrays of one wavelength"),
            ("long", "C1s", "coils, long arrays"),
            ("effect", "C1-", "coil_current_dynamics"),
            ("held", "0.5", "averaged law"),
        ),
    )
    right.set(xlabel="speed, m/s", ylabel="heave damping at held speed, N·s/m")
    figure.savefig(path, metadata={"Date": None})


def _curves(axes, rows: list[dict[str, float]], curves: tuple[tuple[str, str, str], ...]) -> None:
    """Columns of a table over speed; each curve is a column, its style and its label."""
    for name, style, label in curves:
        axes.plot([r["speed"] for r in rows], [r[name] for r in rows], style, ms=3.5, label=label)
    axes.legend(frameon=False)


def show(rows: list[dict[str, float]], digits: int = 3) -> None:
    """A table in Markdown."""
    print("| " + " | ".join(rows[0]) + " |\n" + "|---" * len(rows[0]) + "|")
    for row in rows:
        cells = (
            f"{v:.{digits}f}" if i and not name.endswith("ppm") else f"{v:.3g}"
            for i, (name, v) in enumerate(row.items())
        )
        print("| " + " | ".join(cells) + " |")
    print()


def main() -> None:
    """Print, and draw where asked."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draw", metavar="FILE.svg", type=Path)
    arguments = parser.parse_args()
    forces, heave = forces_table(), heave_table()
    print(f"Forces over the averaged law's at a top gap of {1e3 * (HEAVE + 0.010):g} mm, and ripple over the mean\n")
    show(forces)
    print("Equilibrium gap (mm) and heave damping at held speed (N·s/m)\n")
    show(heave)
    print("By the length of the arrays at 20 m/s, over the averaged law's\n")
    show(ends_table())
    print(
        f"Damping changes its sign at {sign_change(coils()):.2f} m/s (one wavelength), {sign_change(coils(20.0)):.2f}"
        f" (long); R/kL = {corner_speed(Model.default()):.2f} m/s"
    )
    share, moved = failed_coil()
    print(f"One failed coil: {100 * share:.1f} % of the weight at most, heave moves by {1e6 * moved:.1f} µm")
    coupled = coils(mutual_inductance=[4e-7, 1e-7])
    print(
        f"At 40 m/s {pace(coils()):.1f} simulated seconds to a second of one core; with two neighbours coupled"
        f" {pace(coupled):.1f}"
    )
    if arguments.draw:
        draw(arguments.draw, forces, heave)


if __name__ == "__main__":
    main()
