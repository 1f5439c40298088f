# SPDX-License-Identifier: Apache-2.0
"""Put the tables that the code prints into the pages that show them: ``make tables``."""

import re
from pathlib import Path

from inductrack_ros.core import effects_table
from inductrack_ros.data import campaign_keys
from inductrack_ros.nodes import interface_tables
from inductrack_ros.nodes.domain import claim_domain

HERE = Path(__file__).parent


def put(page: str, name: str, text: str) -> None:
    """Replace what stands between ``<!-- NAME: begin -->`` and its end in a page of this folder."""
    path = HERE / page
    begin, end = (f"<!-- {name}: {which} -->" for which in ("begin", "end"))
    old = path.read_text(encoding="utf-8")
    new = re.sub(f"{begin}\n.*\n{end}", lambda _: f"{begin}\n{text.strip()}\n{end}", old, flags=re.DOTALL)
    if new != old:
        path.write_text(new, encoding="utf-8")
        print(f"{path}: {name}")


if __name__ == "__main__":
    claim_domain()  # before rclpy reads the environment: the nodes that are asked are nobody's business
    put("effects.md", "effects table", effects_table.text())
    put("campaigns.md", "keys", campaign_keys.table())
    put("interfaces.md", "interface tables", interface_tables.text())
