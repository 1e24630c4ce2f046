"""Packet sizes shared by the inventory checks and the cost estimates."""

from __future__ import annotations

from typing import Final

ECHO_BYTES: Final = 84
"""Of one echo request as an IP packet with RouterOS' usual 56 bytes of data (20 IP, 8 ICMP); the answer is as long."""
