"""Imported once, by the process that the commands of the test are forks of."""

from __future__ import annotations

from authority_child import warm

warm()
