"""Where everything of the VPN's server is on its computer; the technician's computer says so with each request."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Place"]


@dataclass(frozen=True)
class Place:
    """Paths from the root, and names."""

    ca: str
    ccd: str
    """Folder, ours alone: a file for each common name that is admitted."""
    crl: str
    firewall: str
    """The ruleset's file."""
    table: str
    """The table that it makes, with its family."""
    members: str
    """The set in it that holds the address of everybody who is admitted."""
    socket: str
    status: str
    seen: str
    unit: str
    """That runs the server."""
    firewall_unit: str
    """That loads the ruleset: its stamp says which one was loaded."""
    patience_s: float = 2.0
    """For a word of the management socket."""

    def admission(self, common_name: str) -> str:
        """The file that admits a common name."""
        return f"{self.ccd}/{common_name}"
