"""The physics, without ROS: state, parameters, effects, compiled kernel, model."""
