"""Packet handling of an emulated router: ports and addresses, routes, firewall, netwatch."""
