# SPDX-License-Identifier: Apache-2.0
"""Is the model right while the rig runs? Windows of measurements in, missing forces and a verdict out. Without ROS."""
