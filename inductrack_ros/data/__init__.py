# SPDX-License-Identifier: Apache-2.0
"""Measurements in and out: campaigns, CSV files, rosbag2. No ROS installation needed."""

from ..core.model import Pulses
from .bag_writing import write_bag
from .bags import read_bag
from .campaign import Campaign, load_campaign
from .csv_files import read_csv
from .csv_writing import write_csv, write_prediction
from .measurement import Run

__all__ = [
    "Campaign",
    "Pulses",
    "Run",
    "load_campaign",
    "read_bag",
    "read_csv",
    "write_bag",
    "write_csv",
    "write_prediction",
]
