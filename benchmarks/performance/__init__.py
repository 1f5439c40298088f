# SPDX-License-Identifier: Apache-2.0
"""How fast it is, against its peers on the same work in the same run: ``python -m performance`` in `benchmarks/`."""
