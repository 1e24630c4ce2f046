"""RouterOS version numbers, ordered as MikroTik releases them."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Self

from atlantis_netcfg.core.messages import arg, msg


@dataclass(frozen=True, order=True, slots=True)
class Version:
    """A RouterOS version, `MAJOR.MINOR[.PATCH][betaN|rcN]`; order: beta, rc, stable."""

    major: int
    minor: int
    patch: int = 0
    maturity: int = 2
    build: int = 0

    @classmethod
    def parse(cls, text: str) -> Self:
        """Parse `7.18.2 (stable)` as printed by `/system/resource`. Raises ValueError on anything else."""
        match = re.fullmatch(r"(\d+)\.(\d+)(?:\.(\d+))?(?:(beta|rc)(\d+))?(?: \(.+\))?", text.strip())
        if match is None:
            raise ValueError(msg(f"not a RouterOS version: {arg(text)!r}"))
        major, minor, patch, stage, build = match.groups()
        return cls(int(major), int(minor), int(patch or 0), {"beta": 0, "rc": 1}.get(stage, 2), int(build or 0))

    def __str__(self) -> str:
        patch = f".{self.patch}" if self.patch else ""
        stage = ("beta", "rc", "")[self.maturity]
        return f"{self.major}.{self.minor}{patch}{stage}{self.build if stage else ''}"


NEWEST_KNOWN = Version(7, 24)
"""Newest version with a known command tree; changes in later versions have not been reviewed."""
