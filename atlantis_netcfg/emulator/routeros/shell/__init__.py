"""The text console of a router twin, by SSH and by a serial line.

A `ConsoleSession` is the dialogue alone: bytes of a terminal in, bytes out, line after line handed to the device, so
that a case of a test is a pair of texts. Around it stand the two ways in: `ssh` (asyncssh at the router's end of the
same pipe that carries the API, so that link, faults, firewall and counters act on it) and `serial` (a pty beside the
network). What a line means is not known here: the language is `twin/console`'s, and safe mode, users and files are the
device's.
"""
