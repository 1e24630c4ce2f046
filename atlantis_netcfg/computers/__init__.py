"""Desired state of a gateway computer, computed from the inventory without contacting a device.

Each part of a gateway is a pure function `(inventory, host) -> Part`, whose `as_dict` returns the parameters of the
modules that a role runs on the computer. It is final data: no templates, no secrets.
"""

from __future__ import annotations
