"""The commands of the VPN: its authority, its members, and what brings it to devices."""
