"""Commands of the VPN: its authority, its members, and the installation on devices."""
