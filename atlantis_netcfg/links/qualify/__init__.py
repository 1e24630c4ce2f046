"""Measurement of whether a link carries the mission: test packets, raw samples, figures computed from them.

The sender (`session`) speaks STAMP with a reflector (`reflector`, which runs at the far end), checks its budget before
every packet, and writes each sample as it arrives. `figures`, `search` and `judgement` are pure. `operations.qualify`
uses them for `provision measure link`.
"""

from __future__ import annotations
