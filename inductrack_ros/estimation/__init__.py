# SPDX-License-Identifier: Apache-2.0
"""Fits of the model to measured runs: initial states, parameters, noise."""
