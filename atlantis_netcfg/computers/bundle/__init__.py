"""Bundles: everything that a site's hosts install from elsewhere, for sites without internet access.

Packages are resolved against the dpkg status of the target system, on a computer of any architecture and without root.
They are stored in a signed repository; see `build` for the layout, and `manifest` for trusted keys. A bundle has no
Python wheels, because no role of a gateway needs one. Nothing here reads the inventory: `operations.bundle` collects
what each host needs.
"""

from __future__ import annotations
