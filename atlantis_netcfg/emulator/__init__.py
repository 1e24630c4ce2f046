"""Emulated devices, as strict as the real ones: what a rehearsal and the tests talk to instead of a site."""
