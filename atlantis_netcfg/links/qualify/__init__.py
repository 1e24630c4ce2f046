"""Measures whether a link carries the mission: test packets, raw samples, and figures that are made of samples alone.

The sender (`session`) speaks STAMP with a reflector (`reflector`, which runs at the far end), asks its budget before
every packet, and writes each sample as it comes. `figures`, `search` and `judgement` are pure. `operations.qualify`
puts them to work for `provision qualify`.
"""

from __future__ import annotations
