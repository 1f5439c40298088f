# SPDX-License-Identifier: Apache-2.0
"""A second implementation of the model and a generator of blind campaigns; shares no code with the package."""
