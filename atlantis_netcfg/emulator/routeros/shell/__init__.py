"""The text console of an emulated router, by SSH and serial line.

A `ConsoleSession` is only the dialogue: terminal bytes in, bytes out, each line passed to the device, so that a test
case is a pair of texts. There are two transports: `ssh` (asyncssh at the router's end of the pipe that also carries the
API, so that link, faults, firewall and counters apply) and `serial` (a pty outside the network). The language of the
lines is in `routeros/console`; safe mode, users and files belong to the device.
"""
