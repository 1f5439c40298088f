"""What `inductrack_ros.compare` finds, sorted and written."""
