"""Names and order of the state and of what a rig can measure.

Vehicle-dynamics words, which need no frame: surge is the travel (paper z), sway the slip (paper x, left positive),
heave the lift (paper y, up), roll the angle about the travel. SI and radians.
"""

COORDINATES = ("surge", "sway", "heave", "roll")
RATES = tuple(f"{c}_rate" for c in COORDINATES)
STATES = COORDINATES + RATES
GAPS = ("gap_top", "gap_right", "gap_left")
ACCELERATIONS = tuple(f"{c}_acceleration" for c in COORDINATES)

#: Columns of the simulator's output; all but the last can stand in a measured file.
OUTPUTS = STATES + GAPS + ACCELERATIONS
CHANNELS = OUTPUTS[:-1]
INDEX = {name: i for i, name in enumerate(OUTPUTS)}

UNITS = (
    dict.fromkeys(("surge", "sway", "heave", *GAPS), "m")
    | {"roll": "rad", "roll_rate": "rad/s", "roll_acceleration": "rad/s²"}
    | dict.fromkeys(RATES[:3], "m/s")
    | dict.fromkeys(ACCELERATIONS[:3], "m/s²")
)

#: Coordinates that move for each number of degrees of freedom; the others are held (1: the speed is held too).
MOVING = {1: ("heave",), 2: ("surge", "heave"), 4: COORDINATES}
