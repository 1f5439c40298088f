# SPDX-License-Identifier: Apache-2.0
"""The parts of the blind benchmark (`blind_diagnosis.py`): `judge` an answer, `ask` for one, `loop` campaigns that the
package's own nodes fly, whether an answer hangs on the `last_bits`,
and the `table`s."""

import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "test"))  # `independent`, the generator
