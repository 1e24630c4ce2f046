"""What gpsd 3.22 answers to a client: greeting, requests, and the words for what it does not know.

One piece of data is one text to gpsd: what does not begin with `?` is ignored, requests follow each other, and from the
first that it does not know the rest of the text is an error, also where only the end of a request is still on its way.
`?WATCH;` asks; `?WATCH={…}` switches on unless `enable` says otherwise, but without `json` no report comes; attributes
that it does not know are ignored, and values that it cannot read are false. All of it was seen with gpsd 3.22.
"""

from __future__ import annotations

import json
import re
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.emulator.gnss.reports import PATH, said

if TYPE_CHECKING:
    from atlantis_netcfg.emulator.gnss.spec import GnssSpec

__all__ = ["Client"]

_VERSION = {"class": "VERSION", "release": "3.22", "rev": "3.22", "proto_major": 3, "proto_minor": 14}
_REQUEST = re.compile(r"\?(VERSION|DEVICES|POLL|WATCH|DEVICE);|\?(WATCH|DEVICE)=([^}\n]*[}\n]);?", re.DOTALL)
_FLAG = r'"%s"\s*:\s*([^,}\s]*)'


class Client:
    """One connection."""

    def __init__(self, spec: GnssSpec) -> None:
        self.spec = spec
        self.state = {"enable": False, "json": False, "nmea": False}
        """Of the watching."""
        self.greeting = said(_VERSION)
        self._activated = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%S.000Z")

    def hear(self, data: bytes) -> tuple[bytes, list[str]]:
        """What is answered, and which requests would have changed the receiver, or are none."""
        text = data.decode("utf-8", "replace").removesuffix("\n").removesuffix("\r") + "\n"
        answer = b""
        forbidden: list[str] = []
        while text.startswith("?") or (answer and text.strip()):
            known = _REQUEST.match(text)
            if known is None:
                words = json.dumps(f"Unrecognized request '{text}'")
                return answer + b'{"class":"ERROR","message":' + words.encode() + b"}\r\n", [*forbidden, text]
            answer += self._answer(known[1] or known[2], known[3])
            forbidden += [known[0]] if known[2] == "DEVICE" else []
            text = text[known.end() :].lstrip()
        return answer, forbidden

    def _answer(self, name: str, value: str | None) -> bytes:
        if name == "VERSION":
            return said(_VERSION)
        if name == "DEVICES":
            return said(self._devices())
        if name == "DEVICE":
            return said(self._device()) if self.spec.device else b""
        if name == "POLL":
            now = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%S.000Z")
            return said({"class": "POLL", "time": now, "active": 0, "tpv": [], "gst": [], "sky": []})
        if value is not None:
            self._watch(value)
        settings = {"raw": 0, "scaled": False, "timing": False, "split24": False, "pps": False}
        return said(self._devices(), {"class": "WATCH", **self.state, **settings})

    def _watch(self, value: str) -> None:
        self.state["enable"] = True
        for name in self.state:
            if told := re.search(_FLAG % name, value):
                self.state[name] = told[1] == "true"

    def _device(self) -> dict[str, Any]:
        return {"class": "DEVICE", "path": PATH, "driver": "NMEA0183", "activated": self._activated, "flags": 1}

    def _devices(self) -> dict[str, Any]:
        return {"class": "DEVICES", "devices": [self._device()] if self.spec.device else []}
