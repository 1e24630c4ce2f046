"""What `import-ovpn-configuration` makes of a `.ovpn` file (Manual, OpenVPN).

Documented: tls-crypt and tls-crypt-v2 only from 7.17 on, with `auth SHA256` and `key-direction 1`; no negotiation, so
that the file names its cipher; a user of at most 27 characters is mandatory. Seen in others' exports and scripts: the
interface is called `ovpn-import`, its certificate `cert_ovpn-import`, each with the second at which it was made; an
older version says `unsupported option '<tls-crypt>'` (angristan/openvpn-install#1267).

Other options than these are refused, in the same words; a lacking cipher, SHA256 or direction is refused at once;
nothing is made where anything is refused; the interface is disabled as a new one is.

Assumption: ovpn-import
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

TLS_CRYPT_SINCE = "7.17rc3"
_WRAPS = ("tls-crypt", "tls-crypt-v2")
_BLOCKS = ("ca", "cert", "key", "tls-auth")
_IGNORED = frozenset(
    ("client", "tls-client", "nobind", "persist-key", "persist-tun", "resolv-retry", "remote-cert-tls", "verb", "pull")
)
_CIPHERS = {
    "AES-128-CBC": "aes128-cbc",
    "AES-192-CBC": "aes192-cbc",
    "AES-256-CBC": "aes256-cbc",
    "AES-128-GCM": "aes128-gcm",
    "AES-192-GCM": "aes192-gcm",
    "AES-256-GCM": "aes256-gcm",
    "BF-CBC": "blowfish128",
    "NONE": "null",
}
_AUTHS = {"SHA1": "sha1", "MD5": "md5", "SHA256": "sha256", "SHA512": "sha512", "NONE": "null"}
_PROTOCOLS = {"udp": "udp", "udp4": "udp", "tcp": "tcp", "tcp-client": "tcp", "tcp4-client": "tcp"}
_MODES = {"tun": "ip", "tap": "ethernet"}
_BLOCK = re.compile(r"^<([a-z0-9-]+)>\n(.*?)^</\1>\n?", re.DOTALL | re.MULTILINE)


class OvpnRefused(ValueError):
    """A file that is not taken; the text is what the router says."""


@dataclass(frozen=True, slots=True)
class Imported:
    """What is made of a file."""

    values: Mapping[str, str]
    """Of the interface, as `add` takes them."""
    certificates: str
    """PEM text of the blocks `ca`, `cert` and `key`."""
    wrap: str | None = field(repr=False)
    """The key of `tls-crypt`, which no menu shows."""


def read_ovpn(text: str, *, wraps: bool) -> Imported:
    """Read a file; `wraps`: this version knows tls-crypt. Raises OvpnRefused."""
    text = text.replace("\r\n", "\n")
    blocks = {match[1]: match[2] for match in _BLOCK.finditer(text)}
    for name in blocks:
        if name not in _BLOCKS and not (wraps and name in _WRAPS):
            raise OvpnRefused(f"unsupported option '<{name}>'")
    options = _options(_BLOCK.sub("", text))
    wrap = next((blocks[name] for name in _WRAPS if name in blocks), None)
    values = _values(options)
    if wrap is not None and (values.get("auth"), options.get("key-direction")) != ("sha256", ["1"]):
        raise OvpnRefused("tls-crypt needs auth SHA256 and key-direction 1")
    return Imported(values, "".join(blocks.get(name, "") for name in ("cert", "key", "ca")), wrap)


def _options(text: str) -> dict[str, list[str]]:
    found = {}
    for line in text.split("\n"):
        words = line.split()
        if words and not words[0].startswith(("#", ";")):
            found[words[0]] = words[1:]
    return found


def _values(options: Mapping[str, list[str]]) -> dict[str, str]:
    made: dict[str, str] = {}
    for name, words in options.items():
        if name in _IGNORED or name == "key-direction":
            continue
        made |= _value(name, words)
    if "connect-to" not in made or "cipher" not in made:
        raise OvpnRefused(f"missing option '{'remote' if 'connect-to' not in made else 'cipher'}'")
    return made


def _value(name: str, words: list[str]) -> dict[str, str]:
    try:
        if name == "remote":
            return {"connect-to": words[0], **({"port": words[1]} if len(words) > 1 else {})}
        tables = {"cipher": _CIPHERS, "auth": _AUTHS, "proto": _PROTOCOLS, "dev": _MODES}
        keys = {"proto": "protocol", "dev": "mode"}
        table = tables[name]
        word = words[0] if name in keys else words[0].upper()
        return {keys.get(name, name): table[re.sub(r"\d+$", "", word) if name == "dev" else word]}
    except (KeyError, IndexError):
        text = name if name not in {"remote", "cipher", "auth", "proto", "dev"} else " ".join([name, *words])
        raise OvpnRefused(f"unsupported option '{text}'") from None
