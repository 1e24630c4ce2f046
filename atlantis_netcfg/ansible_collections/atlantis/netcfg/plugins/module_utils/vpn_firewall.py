"""The VPN's table in the kernel: loaded from its file in one act, and read back."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from ipaddress import ip_address, ip_network, summarize_address_range
from typing import TYPE_CHECKING, Any

from .programs import last_lines
from .refused import Refused

if TYPE_CHECKING:
    from typing import Callable, Iterable

    from .programs import Done
    from .stamps import Stamps
    from .tree import Tree
    from .vpn_place import Place

__all__ = ["Firewall"]

_VOLATILE = ("handle", "index", "counter", "metainfo")


@dataclass(frozen=True)
class Firewall:
    """The table of this computer."""

    place: Place
    tree: Tree
    stamps: Stamps
    run: Callable[[list[str]], Done]

    def load(self, content: bytes, source: str) -> None:
        """Load `source`, a file with that content, and note it where the role's unit would. Raises `Refused`."""
        name, desired = self._stamp(content)
        self.stamps.begin(name, desired)
        self.load_only(source)
        self.stamps.note(name, desired)

    def load_only(self, source: str, also: str = "") -> None:
        """Load a file, and in the same act other words of nft, without a note."""
        done = self.run(["nft", f'include "{source}"\n{also}'] if also else ["nft", "-f", source])
        if done.code != 0:
            raise Refused(
                f"the firewall of the VPN could not be loaded, and is what it was (exit {done.code}):\n"
                f"{last_lines(done.said)}",
                "on the server: `nft -c -f` and the file's name tells more",
            )

    def note(self, content: bytes) -> None:
        """Note that a ruleset is loaded, so that the next run of the role leaves its unit alone."""
        self.stamps.note(*self._stamp(content))

    def is_noted(self, content: bytes) -> bool:
        """Whether that ruleset is the one that was loaded last, as far as the toolkit knows."""
        return self.stamps.holds(*self._stamp(content))

    def take_out(self, addresses: Iterable[str]) -> None:
        """Take addresses out of the set of members, one by one: where the whole cannot be loaded."""
        for address in addresses:
            self.run(["nft", "delete", "element", *self.place.table.split(), self.place.members, f"{{ {address} }}"])

    def loaded(self) -> list[dict[str, Any]] | None:
        """The table as the kernel has it; None: it has none. Raises `Refused` where nft does not answer."""
        done = self.run(["nft", "-j", "-s", "list", "table", *self.place.table.split()])
        return _objects(done)

    def members(self) -> list[str] | None:
        """Networks whose members are admitted, from the kernel; None: there is no such set."""
        done = self.run(["nft", "-j", "list", "set", *self.place.table.split(), self.place.members])
        found = _objects(done)
        sets = [row["set"] for row in found or () if "set" in row]
        return sorted(network for item in sets for network in _networks(item.get("elem", ()))) if sets else None

    def is_as(self, path: str) -> bool | None:
        """Whether the kernel's table is what a file makes in an empty network; None: that could not be tried."""
        here = self.loaded()
        if here is None:
            return False
        table = " ".join(self.place.table.split())
        script = f'nft -f "$1" && nft -j -s list table {table}'
        done = self.run(["unshare", "--net", "sh", "-c", script, "sh", path])
        if done.code != 0:
            return None
        return bool(_plain(here) == _plain(_objects(done)))

    def _stamp(self, content: bytes) -> tuple[str, dict[str, str]]:
        return f"unit {self.place.firewall_unit}", {self.place.firewall: hashlib.sha256(content).hexdigest()}


def _objects(done: Done) -> list[dict[str, Any]] | None:
    if done.code != 0:
        if "No such file or directory" in done.said:
            return None
        raise Refused(f"nft does not answer (exit {done.code}):\n{last_lines(done.said)}", "install nftables")
    try:
        return list(json.loads(done.said)["nftables"])
    except (ValueError, KeyError, TypeError) as error:
        raise Refused(f"nft answers what is no JSON: {last_lines(done.said)}", "") from error


def _networks(elements: Iterable[Any]) -> list[str]:
    """Elements of a set of addresses, as networks; a single one may be text, a prefix, a range, or one with options."""
    found: list[str] = []
    for element in elements:
        value = element["elem"]["val"] if isinstance(element, dict) and "elem" in element else element
        if isinstance(value, dict) and "prefix" in value:
            found.append(str(ip_network(f"{value['prefix']['addr']}/{value['prefix']['len']}")))
        elif isinstance(value, dict) and "range" in value:
            first, last = map(ip_address, value["range"])
            found += map(str, summarize_address_range(first, last))
        else:
            found.append(str(ip_network(str(value))))
    return found


def _plain(found: Any) -> Any:  # noqa: ANN401 - JSON
    """Without what differs from load to load: numbers of the kernel, counts, and the order of elements."""
    if isinstance(found, dict):
        plain = {key: _plain(value) for key, value in found.items() if key not in _VOLATILE}
        if isinstance(plain.get("elem"), list):
            plain["elem"] = sorted(plain["elem"], key=lambda entry: json.dumps(entry, sort_keys=True))
        return plain
    return [_plain(item) for item in found] if isinstance(found, list) else found
