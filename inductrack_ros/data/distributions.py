# SPDX-License-Identifier: Apache-2.0
"""Messages of an older distribution in the form that Jazzy and Kilted read: a Range has a number more there."""

from __future__ import annotations

from collections.abc import Callable

from rosbags.convert.converter import migrate_bytes
from rosbags.typesys import Stores, get_typestore

OLDER = (Stores.ROS2_HUMBLE, Stores.ROS2_FOXY)


def migration(msgtype: str) -> Callable[[bytes], bytes | None] | None:
    """What brings a serialized message of this type up to date, None for one that cannot be; None where nothing is to
    be done."""
    now = get_typestore(Stores.ROS2_JAZZY)
    if msgtype not in now.fielddefs:
        return None
    definition = now.generate_msgdef(msgtype, ros_version=2)[0]
    before = [store for store in map(get_typestore, OLDER) if msgtype in store.fielddefs]
    before = [store for store in before if store.generate_msgdef(msgtype, ros_version=2)[0] != definition]
    if not before:
        return None
    kept: dict[str, object] = {}

    def migrated(raw: bytes) -> bytes | None:
        try:
            now.deserialize_cdr(raw, msgtype)
            return raw
        except Exception:  # rosbags raises any
            for store in before:
                try:
                    return bytes(migrate_bytes(store, now, msgtype, msgtype, kept, raw, src_is2=True, dst_is2=True))
                except Exception:
                    continue
        return None

    return migrated
