"""Connections of an emulated router: RouterOS API over TCP and TLS, with an emulated link and faults."""
