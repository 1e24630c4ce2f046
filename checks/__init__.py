"""The face of the pre-test verification for pytest: one test a device and check, read from the inventory."""
