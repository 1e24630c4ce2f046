"""How the making of a card ends when it does not succeed."""

from __future__ import annotations

from atlantis_netcfg.core.errors import DeviceFailed, UsageError

__all__ = ["CardUnfinished", "DeviceRefused", "ImageRefused"]


class ImageRefused(UsageError):
    """The image cannot be used as it is; no card was touched."""


class DeviceRefused(UsageError):
    """The device must not be written, or is not the one that was shown; nothing was written."""


class CardUnfinished(DeviceFailed):
    """Writing began and did not succeed: the card's first block is empty, so it does not boot. Write it again."""
