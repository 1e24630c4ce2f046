"""Lists of records in a received file, YAML or CSV, with the place of every value.

Parsing is as strict as for the inventory (no aliases, tags, merges, Jinja, duplicate keys), and limited in size,
because the sender is not trusted: a small YAML file can expand to gigabytes. Values are the text as typed: `no` stays
`no`.
"""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import yaml

from atlantis_netcfg.core.errors import UsageError, nearest
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.inventory._yaml import Node, parse
from atlantis_netcfg.inventory.findings import Finding, choices, shown_key

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path


_BYTES = 1_000_000
_ROWS = 10_000
_DEPTH = 3
"""Maximum nesting: list, records, values."""
_SUFFIXES = (".yml", ".yaml", ".csv")
_Loader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


@dataclass(frozen=True, slots=True)
class ListRow:
    """One record; omitted and empty values are not in `values`."""

    place: str
    """`FILE:LINE`, for errors."""
    values: Mapping[str, str]


class ListInvalid(UsageError):
    """The file has errors; `errors` holds each with its line."""

    def __init__(self, findings: Sequence[Finding]) -> None:
        self.findings = tuple(sorted(set(findings)))
        self.errors = tuple(UsageError(_message(finding), hint=finding.hint) for finding in self.findings)
        super().__init__(join("\n", self.errors))


def _message(finding: Finding) -> str:
    return msg(f"{arg(finding.file)}:{arg(finding.line)}: {arg(finding.message)}")


def read(path: Path, keys: Sequence[str]) -> tuple[ListRow, ...]:
    """Read records whose keys are in `keys`. Raises UsageError, or ListInvalid with all errors of the file."""
    if path.suffix.lower() not in _SUFFIXES:
        raise UsageError(f"the name of {arg(path)} is neither YAML nor CSV", hint="name it .yml or .csv")
    data = _bytes(path)
    reader = _Csv(str(path), keys) if path.suffix.lower() == ".csv" else _Yaml(str(path), keys)
    rows = reader.read(data)
    if not reader.findings and not rows:
        reader.wrong(1, "it contains no record", msg(f"write one for each device: {arg(choices(keys))}"))
    if len(rows) > _ROWS:
        reader.wrong(
            1, msg(f"there are {arg(len(rows))} records; the maximum is {arg(_ROWS)}"), "split it into two files"
        )
    if reader.findings:
        raise ListInvalid(reader.findings)
    return rows


def _bytes(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            data = file.read(_BYTES + 1)
    except (OSError, ValueError) as error:
        raise UsageError(f"{arg(path)} cannot be read: {arg(getattr(error, 'strerror', None) or error)}") from error
    if len(data) > _BYTES:
        raise UsageError(f"{arg(path)} is larger than {arg(_BYTES // 1_000_000)} MB", hint="split it into two files")
    return data


class _ListReader:
    """Base of the readers: errors of a file, and its allowed keys."""

    def __init__(self, file_name: str, keys: Sequence[str]) -> None:
        self.file_name = file_name
        self.keys = keys
        self.findings: list[Finding] = []

    def wrong(self, line: int, message: str, hint: str) -> None:
        self.findings.append(Finding(self.file_name, line, 1, message, hint))

    def check_key(self, key: str, line: int) -> bool:
        if key in self.keys:
            return True
        near = nearest(key, self.keys)
        hint = msg(f"did you mean `{arg(near)}`?" if near else f"available: {arg(choices(self.keys))}")
        self.wrong(line, msg(f"unknown key `{arg(shown_key(key))}`"), hint)
        return False


class _Yaml(_ListReader):
    """Reader of a YAML list of mappings with scalar values."""

    def read(self, data: bytes) -> tuple[ListRow, ...]:
        if self._too_deep(data):
            return ()
        root, findings = parse(data, self.file_name, None)
        self.findings += findings
        if root is None or root.is_reported:
            return ()
        if not isinstance(root.value, list):
            self.wrong(root.mark.line, "this is not a list", "start each record with `- `")
            return ()
        return tuple(self._row(node) for node in root.value)

    def _too_deep(self, data: bytes) -> bool:
        """Check the nesting by events, which needs no memory; syntax errors are left to the parser."""
        depth = 0
        try:
            for event in yaml.parse(data.decode("utf-8-sig", errors="replace"), Loader=_Loader):
                depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
                if depth > _DEPTH:
                    mark: Any = event.start_mark
                    self.wrong(mark.line + 1, "this is nested too deeply", "a record consists of keys and their values")
                    return True
        except yaml.YAMLError:
            return False
        return False

    def _row(self, node: Node) -> ListRow:
        place = f"{self.file_name}:{node.mark.line}"
        if not isinstance(node.value, dict):
            if not node.is_reported:
                self.wrong(node.mark.line, "this is not a record", "write it as {partner: …, device: …}")
            return ListRow(place, {})
        return ListRow(place, dict(self._values(node)))

    def _values(self, node: Node) -> Iterator[tuple[str, str]]:
        for key, value in node.keys.items():
            line = value.place.line
            if not self.check_key(key, line) or value.value is None or value.is_reported:
                continue
            if isinstance(value.value, dict | list) or not value.text:
                self.wrong(line, msg(f"`{arg(key)}` needs a simple value"), "write a single value")
                continue
            yield key, value.text


class _Csv(_ListReader):
    """Reader of CSV; the first line has the column names."""

    def read(self, data: bytes) -> tuple[ListRow, ...]:
        try:
            text = data.decode("utf-8-sig")
        except UnicodeDecodeError as error:
            line = data.count(b"\n", 0, error.start) + 1
            self.wrong(line, "this line is not UTF-8 text", "save the file as UTF-8")
            return ()
        first = text.partition("\n")[0]
        lines = csv.reader(
            io.StringIO(text, newline=""), strict=True, delimiter=";" if ";" in first and "," not in first else ","
        )
        try:
            return self._rows(lines)
        except csv.Error as error:
            self.wrong(lines.line_num, msg(f"this is not CSV: {arg(error)}"), "quotes must enclose a whole value")
            return ()

    def _rows(self, lines: Any) -> tuple[ListRow, ...]:  # noqa: ANN401 - csv has no public type for its reader
        header = [name.strip() for name in next(lines, [])]
        for name in header:
            if self.check_key(name, 1) and header.count(name) > 1:
                self.wrong(1, msg(f"`{arg(name)}` is here twice"), "keep one of them")
        if self.findings:
            return ()
        return tuple(row for cells in lines if (row := self._row(header, cells, lines.line_num)) is not None)

    def _row(self, header: list[str], cells: list[str], line: int) -> ListRow | None:
        if not any(cells):
            return None
        if len(cells) != len(header):
            self.wrong(
                line,
                msg(f"{arg(len(cells))} values for {arg(len(header))} columns"),
                "write one value for each column, or leave it empty",
            )
        return ListRow(
            f"{self.file_name}:{line}", {name: cell for name, cell in zip(header, cells, strict=False) if cell}
        )
