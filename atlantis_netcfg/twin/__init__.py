"""Emulated devices that speak the real protocol on real sockets, as strict as the devices they stand for."""
