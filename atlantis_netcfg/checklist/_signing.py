"""A named person vouches for a document; and what tells that it is still the one."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.checklist._canonical import canonical, parsed, written
from atlantis_netcfg.checklist._key import fingerprint, fits
from atlantis_netcfg.checklist.report import Document, Signature

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator
    from datetime import datetime

    from atlantis_netcfg.checklist._key import Key

REPORT = "report.json"
MANIFEST = "manifest.json"


@dataclass(frozen=True, slots=True)
class Trouble:
    """Something that is not as it was signed."""

    file: str
    """In the folder of the checklist."""
    what: str
    """`is not as it was signed: …`"""
    hint: str = ""


def digest(data: dict[str, Any]) -> str:
    """SHA-256 (hex) over a document's JSON without its signature, whatever version of this tool wrote it."""
    return hashlib.sha256(canonical({name: value for name, value in data.items() if name != "signed"})).hexdigest()


def signed(document: Document, by: str, at: datetime, key: Key) -> Document:
    """The document with its signature."""
    block = Signature(
        by=by,
        at=at,
        digest=digest(document.model_dump(mode="json")),
        key=key.fingerprint,
        public=key.public,
        signature="",
    )
    signature = sealed(block.model_dump(mode="json"), key)["signature"]
    return document.model_copy(update={"signed": block.model_copy(update={"signature": signature})})


def sealed(data: dict[str, Any], key: Key) -> dict[str, Any]:
    """The data with a signature over all of it: `key` and `public` say whose."""
    whole = data | {"key": key.fingerprint, "public": key.public}
    whole.pop("signature", None)
    return whole | {"signature": key.sign(canonical(whole))}


def broken_seal(data: dict[str, Any], known: Collection[str], *, demanded: bool = False) -> Iterator[tuple[str, str]]:
    """What is wrong with such a signature, and what to do.

    `known`: fingerprints of keys that are trusted; `demanded`: a person has named them, and no other will do.
    """
    rest = {name: value for name, value in data.items() if name != "signature"}
    public, signature = str(data.get("public", "")), str(data.get("signature", ""))
    if not fits(public, signature, canonical(rest)):
        yield "the signature does not fit what stands there", "do not rely on it; ask whoever signed for the original"
        return
    if fingerprint(public) != data.get("key"):
        yield "the fingerprint is not that of the key which has signed", "do not rely on it"
    elif data["key"] not in known:
        yield (
            f"the key {data['key']} has signed it, and another one was asked for"
            if demanded
            else f"this computer does not know the key {data['key']} that has signed it",
            "compare the fingerprint with whoever signed, by telephone or on paper, never with the file itself",
        )


def _goes_on(document: dict[str, Any]) -> str:
    rehearsed = " --rehearse" if document["rehearsed"] else ""
    return (
        f"nobody vouches for it: `provision check site={document['site']}{rehearsed}` goes on with it, on the computer "
        "on which it was made"
    )


def check_report(data: bytes, known: Collection[str], *, demanded: bool = False) -> Iterator[Trouble]:
    """Everything in a `report.json` that is not as it was signed."""
    try:
        document = parsed(data)
        same = written(document) == data
        Document.model_validate(document)
    except ValueError:
        yield Trouble(REPORT, "is no report of a checklist, or is damaged", "ask whoever signed for the original")
        return
    block = document.get("signed")
    if block is None:
        yield Trouble(REPORT, "is not signed", _goes_on(document))
        return
    if block["digest"] != digest(document):
        yield Trouble(REPORT, "was changed after it was signed", "do not rely on it; ask for the original")
    elif not same:
        yield Trouble(REPORT, "says what was signed, but not byte for byte as it was written", "ask for the original")
    for what, hint in broken_seal(block, known, demanded=demanded):
        yield Trouble(REPORT, what, hint)
