# SPDX-License-Identifier: Apache-2.0
"""Maps for planning runs: axes over anything a run depends on, many runs side by side, what an engineer reads off
each."""
