# SPDX-License-Identifier: Apache-2.0
"""Simulation and model diagnosis of the Inductrack maglev cradle of Kim and Ge (2012)."""
