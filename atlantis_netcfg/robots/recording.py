"""Recording to rosbag2 bags, readable by ROS from Foxy on: sqlite3, QoS as numbers.

The configuration topic contains the robots' tokens, so the folder is readable by its owner only.
"""

from __future__ import annotations

import shutil
import time
from typing import TYPE_CHECKING, Any, Final, Self

from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.inventory.loader import shown_path

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path
    from types import TracebackType

    from atlantis_netcfg.robots.message_types import MessageTypes
    from atlantis_netcfg.robots.observation import HeardWriter

LARGEST_BAG: Final = 1_000_000_000
"""Maximum bytes of messages in a bag."""
_FREE: Final = 500_000_000
"""Bytes that must stay free on the disk."""
_LOOK_EVERY: Final = 1_000_000
"""Bytes written between two checks of the free disk space."""
_VERSION: Final = 8
"""Metadata version: the newest whose QoS format Foxy understands; Foxy ignores unknown keys."""
_DEPTH: Final = 10


class BagRecorder:
    """Writes one bag, until it is closed, too large, or the disk too full."""

    def __init__(self, folder: Path, types: MessageTypes, most: int = LARGEST_BAG, free: int = _FREE) -> None:
        """Nothing is created yet. Raises UsageError if the folder already exists."""
        if folder.exists() or folder.is_symlink():
            raise UsageError(f"{arg(shown_path(folder))} already exists", hint="choose a new folder")
        self.folder = folder
        self.messages = self.octets = 0
        self.reason = ""
        """Why the recording ended early."""
        self._types, self._most, self._free = types, most, free
        self._octets_at_look = -_LOOK_EVERY
        self._bag: Any = None  # of rosbags
        self._topics: dict[tuple[object, ...], Any] = {}
        self._began_ns = time.time_ns() - time.monotonic_ns()

    def __enter__(self) -> Self:
        """Create the bag folder. Raises UsageError on failure."""
        from rosbags.rosbag2 import Writer  # noqa: PLC0415 - it brings numpy

        bag = Writer(self.folder, version=_VERSION)
        try:
            self.folder.parent.mkdir(parents=True, exist_ok=True)
            bag.open()
            self.folder.chmod(0o700)
        except OSError as error:
            message = msg(f"cannot create {arg(shown_path(self.folder))}: {arg(error.strerror)}")
            raise UsageError(message, hint="choose a folder that you can write to") from error
        self._bag = bag
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Finish the bag, also after an interrupt; without messages the folder is removed."""
        from sqlite3 import Error  # noqa: PLC0415 - as above

        if not self.messages:
            self._bag.abort()
            shutil.rmtree(self.folder, ignore_errors=True)
            return
        try:
            self._bag.close()
        except (OSError, Error) as problem:
            self.messages = self.octets = 0
            self.reason = msg(f"it could not be completed: {arg(problem)}")

    def add(self, writer: HeardWriter, data: bytes) -> None:
        """Write a message that has just come."""
        from sqlite3 import Error  # noqa: PLC0415 - as above

        if self.reason:
            return
        self.reason = self._stop_reason(len(data))
        if self.reason:
            return
        try:
            self._bag.write(self._topic(writer), self._began_ns + time.monotonic_ns(), data)
        except (OSError, Error) as error:
            self.reason = str(error)
            return
        self.messages += 1
        self.octets += len(data)

    def _stop_reason(self, size: int) -> str:
        if self.octets + size > self._most:
            return msg(f"it would be larger than {arg(self._most / 1e6):g} MB")
        if self.octets + size < self._octets_at_look + _LOOK_EVERY:
            return ""
        self._octets_at_look = self.octets
        if shutil.disk_usage(self.folder).free - size < self._free:
            return msg(f"less than {arg(self._free / 1e6):g} MB would be free on the disk")
        return ""

    def _topic(self, writer: HeardWriter) -> Any:  # noqa: ANN401 - a connection of rosbags
        from rosbags.interfaces import (  # noqa: PLC0415 - as above
            Qos,
            QosDurability,
            QosHistory,
            QosLiveliness,
            QosReliability,
            QosTime,
        )

        key = (writer.topic, writer.type, writer.reliable, writer.transient_local)
        if key not in self._topics:
            reliability = QosReliability.RELIABLE if writer.reliable else QosReliability.BEST_EFFORT
            durability = QosDurability.TRANSIENT_LOCAL if writer.transient_local else QosDurability.VOLATILE
            never = QosTime(0, 0)
            qos = Qos(
                QosHistory.KEEP_LAST,
                _DEPTH,
                reliability,
                durability,
                never,
                never,
                QosLiveliness.AUTOMATIC,
                never,
                avoid_ros_namespace_conventions=False,
            )
            self._topics[key] = self._bag.add_connection(
                writer.topic, writer.type, typestore=self._types.store, offered_qos_profiles=[qos]
            )
        return self._topics[key]

    def as_dict(self) -> Mapping[str, object]:
        """As JSON-able data."""
        return {
            "folder": str(self.folder),
            "messages": self.messages,
            "bytes": self.octets,
            "topics": len({topic for topic, *_ in self._topics}),
            "ended_early": self.reason or None,
        }
