# SPDX-License-Identifier: Apache-2.0
"""``track: coils``: every lifting coil a circuit of its own, (1)–(5) of Kim and Ge (2012) before they are averaged.

- `settings` declares the options, and `field` makes the table of the arrays' field.
- `circuits` (currents) and `flight` (currents and cradle together) are texts that `kernel` compiles behind the
  integrator.
- `seam` is where the coils' forces enter the equations.
- `track` is what `Model` calls."""
