# SPDX-License-Identifier: Apache-2.0
"""Which physical effect is missing: adequacy, ranking, decision, ignorance admitted."""
