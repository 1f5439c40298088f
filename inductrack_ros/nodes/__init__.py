"""ROS 2 nodes: message → record, advance, record → message; no equations."""
