# SPDX-License-Identifier: Apache-2.0
"""From the table of an unknown force to laws that one can add."""
