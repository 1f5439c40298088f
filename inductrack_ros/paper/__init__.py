# SPDX-License-Identifier: Apache-2.0
"""Kim and Ge (2012) reproduced: what the paper prints (`facts`), what the model gives (`runs`, `stability`, `drive`,
`identification`), and the page."""
