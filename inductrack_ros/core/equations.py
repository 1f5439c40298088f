# SPDX-License-Identifier: Apache-2.0
"""The 4-DOF model of Kim and Ge (2012), equation by equation, as `kernel` compiles it.

This function is a text as well as a program: the kernel takes its statements in order and calls each effect right
after the statement that gives the quantity the effect changes. So every name assigned here is a quantity an effect
may ask for (once it has been assigned) or change. Paper frame: x lateral (left), y up, z forward; SI.

Array 1 is on top, 2 on the right (−x), 3 on the left (+x); outward unit normals of the track
n_1 = (0, 1), n_2 = (−c, −c), n_3 = (c, −c), c = √½.
"""

from math import cos, exp, pi, sin, sqrt

SQRT_HALF = sqrt(0.5)


def equations(
    # the moment
    time, travel, pulse_current, averaged, drive_current, touching_top, touching_right, touching_left,
    surge, sway, heave, roll, surge_rate, sway_rate, heave_rate, roll_rate,
    # the parameters (see parameters.py)
    eta, gamma, peak_field, wavelength, inductance, resistance, mass, pulse_length, coils_per_wavelength,
    width_top, width_side, gravity, nominal_gap, contact_stiffness, contact_damping, roll_inertia,
    magnet_top_height, magnet_side_offset, magnet_side_height,
):  # fmt: skip
    """Quantities of the model at one moment; returns all of them by name.

    ``travel`` is the surge since the run began (m). If ``averaged``, thrust follows the averaged law (39) with
    ``drive_current`` (A), and ``pulse_current`` (A) is what flows beyond that where a run's current was measured in
    time. If not, it follows the pulses, and ``pulse_current`` is their sum Σ I sin(π(t−t0)/τ) cos(k(z−z_n)).
    ``touching_*`` say which arrays are in contact, which the integrator decides between its steps.
    """
    width_right = width_side
    width_left = width_side
    track_height = 0.0
    track_height_rate = 0.0
    wave_number = 2.0 * pi / wavelength
    speed = max(surge_rate, 0.0)  # no magnetic drag or thrust at v ≤ 0
    omega = wave_number * speed

    # Gaps and their rates, (29)–(34): heave and roll of the magnets' centres against the track.
    c_roll = cos(roll)
    s_roll = sin(roll)
    height = heave - track_height
    height_rate = heave_rate - track_height_rate
    arm_top_x = -s_roll * magnet_top_height
    arm_top_y = c_roll * magnet_top_height
    arm_right_x = -c_roll * magnet_side_offset - s_roll * magnet_side_height
    arm_right_y = -s_roll * magnet_side_offset + c_roll * magnet_side_height
    arm_left_x = c_roll * magnet_side_offset - s_roll * magnet_side_height
    arm_left_y = s_roll * magnet_side_offset + c_roll * magnet_side_height
    gap_top = nominal_gap + height + arm_top_y - magnet_top_height
    gap_right = nominal_gap - SQRT_HALF * (
        sway + arm_right_x + magnet_side_offset + height + arm_right_y - magnet_side_height
    )
    gap_left = nominal_gap + SQRT_HALF * (
        sway + arm_left_x - magnet_side_offset - height - arm_left_y + magnet_side_height
    )
    gap_top_rate = height_rate + roll_rate * arm_top_x
    gap_right_rate = -SQRT_HALF * (sway_rate - roll_rate * arm_right_y + height_rate + roll_rate * arm_right_x)
    gap_left_rate = SQRT_HALF * (sway_rate - roll_rate * arm_left_y - height_rate - roll_rate * arm_left_x)

    # Overlap of field and circuits, and the flux they catch, (35); finite however far below the track an array of no
    # width is.
    overlap_top = width_top * exp(min(-wave_number * gap_top, 700.0))
    overlap_right = width_right * exp(min(-wave_number * gap_right, 700.0))
    overlap_left = width_left * exp(min(-wave_number * gap_left, 700.0))
    overlap = overlap_top + overlap_right + overlap_left
    flux = eta * peak_field / wave_number * overlap
    flux_rate = (
        -eta * peak_field * (overlap_top * gap_top_rate + overlap_right * gap_right_rate + overlap_left * gap_left_rate)
    )

    # The steady coil current I = jωΦ/(R + jωL): its real part lifts, its imaginary part brakes.
    reactance = omega * inductance
    impedance_squared = resistance * resistance + reactance * reactance
    current_lift = flux * omega * reactance / impedance_squared
    current_drag = flux * omega * resistance / impedance_squared

    # Repulsion (36), drag (38), thrust (39).
    force_per_overlap = coils_per_wavelength * peak_field
    repulsion_top = overlap_top * force_per_overlap * current_lift
    repulsion_right = overlap_right * force_per_overlap * current_lift
    repulsion_left = overlap_left * force_per_overlap * current_lift
    magnetic_drag = overlap * force_per_overlap * current_drag
    if averaged:
        drive = 4.0 * speed / wavelength * pulse_length / pi * (drive_current + pulse_current)
    else:
        drive = pulse_current
    thrust = gamma * overlap * peak_field * drive

    # Contact (25), never adhesive: the track's normal force on each array, ≥ 0.
    normal_top = -(contact_stiffness * gap_top + contact_damping * gap_top_rate) if touching_top else 0.0
    normal_right = -(contact_stiffness * gap_right + contact_damping * gap_right_rate) if touching_right else 0.0
    normal_left = -(contact_stiffness * gap_left + contact_damping * gap_left_rate) if touching_left else 0.0
    normal_force = max(normal_top, 0.0) + max(normal_right, 0.0) + max(normal_left, 0.0)

    # Sum over the arrays, (37) and (40); the moment is Σ (A r'_i) × F_i n_i.
    push_top = repulsion_top + normal_top
    push_right = repulsion_right + normal_right
    push_left = repulsion_left + normal_left
    force_surge = thrust - magnetic_drag
    force_sway = SQRT_HALF * (push_left - push_right)
    force_heave = push_top - SQRT_HALF * (push_right + push_left) - mass * gravity
    moment_roll = (
        arm_top_x * push_top
        + SQRT_HALF * push_right * (arm_right_y - arm_right_x)
        - SQRT_HALF * push_left * (arm_left_x + arm_left_y)
    )
    return locals()
