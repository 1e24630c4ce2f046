"""Bundles: everything that the roles of a site's hosts take from elsewhere, carried to where there is no internet.

Packages are resolved against the dpkg status of the system that they are for, on a computer of any architecture and
without root, and stand in a signed repository; see `build` for what lies where, and `signing` for who is trusted.
There are no Python wheels in a bundle, because no role of a gateway needs one. Nothing here knows the declaration:
`operations.bundle` says what each host needs.
"""

from __future__ import annotations
