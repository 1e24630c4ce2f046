"""Packet sizes shared by the inventory checks and the cost estimates."""

from __future__ import annotations

from typing import Final

ECHO_BYTES: Final = 84
"""Size of an echo request as an IP packet with RouterOS' default of 56 bytes (20 IP, 8 ICMP); same for the response."""
