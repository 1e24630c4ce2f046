"""Bundles: everything that the roles of a site's hosts take from elsewhere, carried to where there is no internet.

Packages are resolved against the dpkg status of the system that they are for, on a computer of any architecture and
without root, and stand in a signed repository; see `making` for what lies where, and `signing` for whom is trusted.
There are no Python wheels in a bundle, because no role of a gateway needs one. Nothing here knows the declaration:
`operations.bundling` says what each host needs.
"""

from __future__ import annotations

from atlantis_netcfg.bundle._errors import BundleRefused
from atlantis_netcfg.bundle.build import Order, Purpose, Size, make
from atlantis_netcfg.bundle.manifest import Manifest
from atlantis_netcfg.bundle.mirrors import archive
from atlantis_netcfg.bundle.open import Bundle, bytes_to_carry, open_bundle
from atlantis_netcfg.bundle.signing import Keys
from atlantis_netcfg.bundle.target import Target, read_target
from atlantis_netcfg.bundle.wish import HostWish, Key, Library, Source, Wished

__all__ = [
    "Bundle",
    "BundleRefused",
    "HostWish",
    "Key",
    "Keys",
    "Library",
    "Manifest",
    "Order",
    "Purpose",
    "Size",
    "Source",
    "Target",
    "Wished",
    "archive",
    "bytes_to_carry",
    "make",
    "open_bundle",
    "read_target",
]
