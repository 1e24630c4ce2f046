"""What the server tells in `status 3`: rows, whose columns are found by their names in the HEADER rows alone."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Dict

if TYPE_CHECKING:
    from typing import Iterable, Iterator

__all__ = ["END", "Session", "Torn", "rows", "sessions", "written"]

END = "END"
Session = Dict[str, Any]
"""`cid`, `common_name` (`UNDEF` before the certificate came), `real`, `virtual`, `since`, `received`, `sent`."""
_KIND = "CLIENT_LIST"


class Torn(Exception):
    """The text is no status of version 3, or not the whole of one."""


def rows(lines: Iterable[str], kind: str = _KIND) -> Iterator[dict[str, str]]:
    """The rows of a kind, by the names of their columns. Raises `Torn`."""
    names: list[str] | None = None
    ended = False
    for line in lines:
        first, *fields = line.rstrip("\r\n").split("\t")
        if first == "HEADER" and fields[:1] == [kind]:
            names = fields[1:]
        elif first == kind:
            if names is None or len(fields) != len(names):
                raise Torn(f"a row of {kind} is not as its header: {line[:200]!r}")
            yield dict(zip(names, fields))
        ended = ended or first == END
    if names is None or not ended:
        raise Torn("the status has no end" if names is not None else f"the status has no header of {kind}")


def sessions(lines: Iterable[str]) -> list[Session]:
    """Everybody who has a session. Raises `Torn`."""
    try:
        return [_session(row) for row in rows(lines)]
    except (KeyError, ValueError) as error:
        raise Torn(f"a row of {_KIND} is not as it should be: {error}") from error


def written(lines: Iterable[str]) -> int:
    """When a status was written, in seconds since 1970; 0: it does not tell."""
    times = [line.rstrip("\r\n").split("\t") for line in lines if line.startswith("TIME\t")]
    return int(times[0][2]) if times and len(times[0]) > 2 and times[0][2].isdigit() else 0  # noqa: PLR2004 - TIME, words, seconds


def _session(row: dict[str, str]) -> Session:
    return {
        "cid": int(row["Client ID"]),
        "common_name": row["Common Name"],
        "real": row["Real Address"],
        "virtual": row["Virtual Address"],
        "since": int(row["Connected Since (time_t)"]),
        "received": int(row["Bytes Received"]),
        "sent": int(row["Bytes Sent"]),
    }
