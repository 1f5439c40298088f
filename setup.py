# SPDX-License-Identifier: Apache-2.0
"""Package description for pip and for colcon (ament_python)."""

import xml.etree.ElementTree as ElementTree
from glob import glob
from pathlib import Path

from setuptools import find_packages, setup

NAME = "inductrack_ros"
MANIFEST = ElementTree.parse(Path(__file__).with_name("package.xml"))  # where ROS tools raise the version

setup(
    name=NAME,
    version=MANIFEST.findtext("version"),
    description="Real-time simulation and model diagnosis of the Inductrack maglev cradle, as a ROS 2 package",
    license="Apache-2.0",
    maintainer="inductrack_ros maintainers",
    maintainer_email="maintainers@users.noreply.h-seed-6504a9f7.example",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["**/*.yaml", "**/*.json", "**/*.js", "**/*.css", "**/*.html"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", glob("launch/*.launch.py")),
        (f"share/{NAME}/config", glob("config/*")),
        (f"share/{NAME}/rviz", glob("rviz/*.rviz")),
        (f"share/{NAME}/layouts", glob("layouts/*")),
    ],
    python_requires=">=3.10",
    # xarray: the maps of `sweep` as NetCDF, through SciPy; 2023.1 is the oldest that a distribution we serve has
    #     (Debian 12).
    install_requires=[
        "setuptools",
        "numpy",
        "scipy",
        "numba",
        "PyYAML",
        "pandas>=2",
        "xarray>=2023.1",
        "rosbags>=0.11",
        "plotly",
        "jinja2",
        "markupsafe",
        "threadpoolctl",
        "rich",
    ],
    extras_require={
        # ROS 2 Jazzy as PyPI wheels, for machines without a distribution; never installed over a sourced one.
        "ros": [
            "ros-rclpy[fastrtps]==7.1.6",
            "ros-std-msgs==5.3.6",
            "ros-geometry-msgs==5.3.6",
            "ros-sensor-msgs==5.3.6",
            "ros-nav-msgs==5.3.6",
            "ros-visualization-msgs==5.3.6",
            "ros-diagnostic-msgs==5.3.6",
            "ros-std-srvs==5.3.6",
            "ros-rosgraph-msgs==2.0.3",
        ],
        "test": [
            "pytest",
            "pytest-xdist",
            "hypothesis",
            "import-linter",
            "ruff>=0.15,<0.16",
            "pyright[nodejs]==1.1.414",  # with a node of its own; another version finds other things
            "colcon-common-extensions",
            "dask[distributed]",
        ],
        # The linters of ROS 2 that come as wheels, and what they call.
        "ament": ["ros-ament-flake8==0.17.3", "ros-ament-pep257==0.17.3", "flake8", "pydocstyle"],
        "docs": ["sphinx>=8,<9", "myst-parser", "furo"],
        "cluster": ["dask[distributed]"],
        "benchmark": ["pysindy>=2.1", "pyoperon>=0.6", "scikit-sundae", "matplotlib"],
    },
    zip_safe=True,
    entry_points={
        "console_scripts": [
            f"inductrack = {NAME}.cli:main",
            f"sim = {NAME}.nodes.start:sim",
            f"track_controller = {NAME}.nodes.start:track_controller",
            f"record = {NAME}.nodes.start:record",
            f"monitor = {NAME}.nodes.start:monitor",
            f"play = {NAME}.nodes.start:play",
        ]
    },
)
