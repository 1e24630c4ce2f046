"""A network of our own, in which the router's declared address is on loopback; needs root."""

from __future__ import annotations

import ctypes
import os
import subprocess

__all__ = ["enter"]

_NEW_NETWORK = 0x40000000
"""CLONE_NEWNET, see unshare(2)."""


def enter(address: str) -> str | None:
    """Move this thread and what it starts from now on; None, or why that cannot be."""
    if os.geteuid() != 0:
        return "making a network namespace needs root"
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.unshare(_NEW_NETWORK) != 0:
        return f"making a network namespace failed: {os.strerror(ctypes.get_errno())}"
    for command in ("link set lo up", f"address add {address}/32 dev lo"):
        subprocess.run(["ip", *command.split()], check=True)  # noqa: S603, S607 - iproute2 of this machine
    return None
