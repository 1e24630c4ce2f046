"""Emulated devices for rehearsals and tests, as strict as the real ones."""
