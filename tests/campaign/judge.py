"""What devices are, read from outside by a client of others, and what follows for the words of a run."""

import json
import re
import ssl
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Self

from campaign.site import ADDRESSES, ADMIN, CHECKOUT, STRANGER, Site

Rows = list[dict[str, Any]]

_JOBS, _SAFE_MODE, _LISTS = "system/scheduler", "safe-mode", "ip/firewall/address-list"
_PACKAGES, _FILES = "system/package", "file"
_MARKER = "atlantis-run"
_ALWAYS = (_JOBS, _SAFE_MODE, _LISTS, "system/script", "user", "system/identity", _PACKAGES, _FILES)
_MOVES = {
    ".id", ".nextid", ".about", "bytes", "packets", "uptime", "running", "status", "next-run", "run-count", "since",
    "last-logged-in", "creation-time", "last-seen", "done-tests", "failed-tests", "sent-count", "response-count",
    "date", "time", "tx-byte", "rx-byte", "tx-packet", "rx-packet", "fp-rx-byte", "fp-tx-byte", "fp-rx-packet",
    "fp-tx-packet", "fp-rx-drop", "expires-after", "last-link-up-time", "last-link-down-time", "link-downs",
    "active", "inactive", "cache-used", "gmt-offset", "expired", "slave", "loss-count", "loss-percent", "immediate-gw",
    "local-address", "rx-drop", "tx-drop", "rx-error", "tx-error", "tx-queue-drop", "dst-active", "poe-out-status",
    "actual-mtu", "invalid", "root-path-cost", "mac-address", "hw", "registered-clients", "build-time",
}  # fmt: skip
"""State, not configuration: these fields change by themselves."""


@dataclass(frozen=True)
class Picture:
    host: str
    menus: Mapping[str, Rows | None]
    error: str = ""

    @cached_property
    def configured(self) -> dict[str, list[str]]:
        """Each menu's rows as lines, without what the device adds or counts by itself, and without somebody else's."""
        left_out = (_JOBS, _SAFE_MODE, _FILES)
        return {menu: self._lines(menu) for menu in self.menus if menu not in left_out}

    @property
    def foreign(self) -> list[str]:
        """Rows of somebody else's."""
        rows = [(menu, row) for menu, rows in self.menus.items() for row in rows or ()]
        return sorted(f"{menu}: {_line(row)}" for menu, row in rows if row.get("comment") == "foreign")

    @property
    def armed(self) -> list[str]:
        """What a run has left on the device: jobs of ours, markers, packages, safe mode that is not a colleague's."""
        jobs = [f"job {row.get('name')}" for row in self.menus.get(_JOBS) or () if "atlantis" in str(row.get("name"))]
        marks = [
            f"marker {row.get('comment', '')}" for row in self.menus.get(_LISTS) or () if _MARKER in json.dumps(row)
        ]
        packages = [f"package file {row['name']}" for row in self.menus.get(_FILES) or () if row["type"] == "package"]
        held = [row for row in self.menus.get(_SAFE_MODE) or () if row.get("enabled") in (True, "true", "yes")]
        ours = [row for row in held if f"{ADMIN.name}@" not in str(row.get("owner"))]
        return [*jobs, *marks, *packages, *(f"safe mode is held by {row.get('owner', 'somebody')}" for row in ours)]

    def _lines(self, menu: str) -> list[str]:
        rows = [row for row in self.menus[menu] or () if not _dynamic(row) and row.get("comment") != "foreign"]
        return [_line(row) for row in rows if _MARKER not in json.dumps(row)]

    def differs(self, other: "Picture") -> list[str]:
        """Lines that one has and the other has not, and the menus whose order counts and is another one."""
        found = []
        for menu in sorted({*self.configured, *other.configured}):
            here, there = self.configured.get(menu, []), other.configured.get(menu, [])
            if here == there or (menu not in _ORDERED and sorted(here) == sorted(there)):
                continue
            found += [f"{self.host} {menu} - {line}" for line in there if line not in here]
            found += [f"{self.host} {menu} + {line}" for line in here if line not in there]
            if sorted(here) == sorted(there):
                found.append(f"{self.host} {menu}: another order")
        return found


_ORDERED = ("ip/firewall/filter", "ip/firewall/nat", "ip/firewall/mangle", "ip/firewall/raw", "queue/simple")


def _dynamic(row: Mapping[str, Any]) -> bool:
    return row.get("dynamic") in (True, "true", "yes")


def _line(row: Mapping[str, Any]) -> str:
    return " ".join(f"{name}={value}" for name, value in sorted(row.items()) if name not in _MOVES)


class Stranger:
    """The client in its own process and environment."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._process = subprocess.Popen(
            [str(CHECKOUT / ".venv-strangers/bin/python"), "-I", str(CHECKOUT / "tests/campaign/stranger.py")],
            env={"HOME": str(folder), "PATH": "/usr/bin:/bin"},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.communicate()

    def read(self, site: Site, menus: Mapping[str, Sequence[str]], timeout_s: float = 10.0) -> dict[str, Picture]:
        return {host: self._read(site, host, menus[host], timeout_s) for host in ADDRESSES}

    def _read(self, site: Site, host: str, menus: Sequence[str], timeout_s: float) -> Picture:
        port = site.twins.ready[host]["api_ssl"]
        ca = self._folder / f"{host}.pem"
        try:
            ca.write_text(ssl.get_server_certificate(("127.0.0.1", port), timeout=timeout_s), encoding="ascii")
        except OSError as error:
            return Picture(host, {}, f"{type(error).__name__}: {error}")
        job = {
            "host": "127.0.0.1",
            "port": port,
            "user": STRANGER.name,
            "password": STRANGER.password,
            "ca": str(ca),
            "menus": list(menus),
            "timeout_s": timeout_s,
        }
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        print(json.dumps(job), file=self._process.stdin, flush=True)
        answer = json.loads(self._process.stdout.readline())
        return Picture(host, {}, answer["error"]) if "error" in answer else Picture(host, answer)


def menus_of(exports: Sequence[str]) -> list[str]:
    """Every menu of these exports, and those in which runs leave something."""
    named = {found.replace(" ", "/") for text in exports for found in re.findall(r"(?m)^/([a-z0-9 -]+)$", text)}
    return sorted({*named, *_ALWAYS})
