# SPDX-License-Identifier: Apache-2.0
"""What `inductrack_ros.compare` finds, sorted and written."""
