# SPDX-License-Identifier: Apache-2.0
"""The folder is imported by one name, `independent`, from wherever pytest starts."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))
