# SPDX-License-Identifier: Apache-2.0
"""Publishers and subscriptions whose quality of service a parameter file may override, as `qos_overrides` of ROS 2
does."""

from __future__ import annotations

from collections.abc import Callable

from rcl_interfaces.msg import SetParametersResult
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import InvalidQosOverridesError, QoSOverridingOptions, QoSPolicyKind
from rclpy.subscription import Subscription

from ..core.errors import InputError

DEPTH = 1000  # of every queue that has no reason for another
#: What rclpy raises for an override of a wrong type or name.
_ODD = AssertionError, AttributeError, OverflowError, RuntimeError, TypeError, ValueError
_POLICIES = QoSPolicyKind.HISTORY, QoSPolicyKind.DEPTH, QoSPolicyKind.RELIABILITY


def profile(reliable: bool = True, depth: int = DEPTH, latched: bool = False) -> QoSProfile:
    """Keep last; volatile unless ``latched``."""
    return QoSProfile(
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


def publisher(node: Node, kind: type, topic: str, qos: QoSProfile, must_be_reliable: str = "") -> Publisher:
    """A publisher; ``must_be_reliable`` says why an override may not make it best effort. Raises `InputError`."""
    options = _options(must_be_reliable)
    return _made(lambda: node.create_publisher(kind, topic, qos, qos_overriding_options=options), node, topic)


def subscribe(
    node: Node, kind: type, topic: str, callback: Callable, qos: QoSProfile, must_be_reliable: str = ""
) -> Subscription:
    """The same for a subscription."""
    options = _options(must_be_reliable)
    return _made(
        lambda: node.create_subscription(kind, topic, callback, qos, qos_overriding_options=options), node, topic
    )


def _options(must_be_reliable: str) -> QoSOverridingOptions:
    def check(qos: QoSProfile) -> SetParametersResult:
        lossy = bool(must_be_reliable) and qos.reliability == ReliabilityPolicy.BEST_EFFORT
        return SetParametersResult(successful=not lossy, reason=must_be_reliable if lossy else "")

    return QoSOverridingOptions(_POLICIES, callback=check)


def _made(make: Callable, node: Node, topic: str):
    try:
        return make()
    except InvalidQosOverridesError as error:
        raise InputError(
            f"{node.get_name()}: qos_overrides of {topic}: {str(error).rpartition('not valid: ')[2]}"
        ) from None
    except (*_ODD, InvalidParameterTypeException, InvalidParameterValueException) as error:
        raise InputError(
            f"{node.get_name()}: qos_overrides of {topic}: {str(error) or 'no such value'}; history is keep_last or"
            " keep_all, depth a whole number, reliability reliable or best_effort"
        ) from None
