"""Sizes of packets that the declaration and the devices' costs both reckon with."""

from __future__ import annotations

from typing import Final

ECHO_BYTES: Final = 84
"""Of one echo request as an IP packet with RouterOS' usual 56 bytes of data (20 IP, 8 ICMP); the answer is as long."""
