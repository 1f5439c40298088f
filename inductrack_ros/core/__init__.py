# SPDX-License-Identifier: Apache-2.0
"""The physics, without ROS: state, parameters, effects, compiled kernel, model."""
