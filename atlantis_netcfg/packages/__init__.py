"""RouterOS packages: what a given set of `.npk` files would do to a device, and whether it may.

A set is read from its files' own headers, never from their names alone, and judged against what the device says it has:
all of one version, all for its architecture, and every package that is installed has its successor in the set, so that
no radio or modem is lost by an upgrade. Whoever carries the set to the device asks here first; nothing here has a wire.
"""

from __future__ import annotations

from atlantis_netcfg.packages.npk import NotAPackage, Npk, read_npk
from atlantis_netcfg.packages.plan import Installed, Package, Upgrade, UpgradeRefused, plan

__all__ = ["Installed", "NotAPackage", "Npk", "Package", "Upgrade", "UpgradeRefused", "plan", "read_npk"]
