"""Golden cases: `<case>.yml` spoils a copy of the shipped inventory, `<case>.txt` is exactly what a person is told.

An edit is one of `{file, old, new}` (`old` stands there exactly once; a mark `# EXAMPLE` between its lines need not be
repeated), `{file, content}`, `{file, content, times}`, `{remove}`, `{rename, to}`, `{fifo}`, `{folder}`, `{link, to}`.
`python tests/errors/inventory_cases.py` writes the expected texts anew: read the difference before you commit it.
"""

import os
import re
import shutil
import tempfile
from pathlib import Path
from typing import TypedDict

import yaml

from atlantis_netcfg.core.errors import NoMatchError
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.inventory import load as loaded
from atlantis_netcfg.inventory import report, validate
from atlantis_netcfg.operations.common.traffic_budget import inventory_warnings

HERE = Path(__file__).parent
SHIPPED = HERE.parents[1] / "inventory"


class Edit(TypedDict, total=False):
    file: str
    old: str
    new: str
    content: str
    times: int
    fifo: str
    folder: str
    link: str
    remove: str
    rename: str
    to: str


class Case(TypedDict):
    why: str
    edits: list[Edit]


def cases() -> list[Path]:
    return sorted(HERE.glob("*.yml"))


def load(path: Path) -> Case:
    case: Case = yaml.safe_load(path.read_text(encoding="utf-8"))
    return case


def spoil(case: Case, folder: Path) -> Path:
    """A copy of the shipped inventory in `folder`, with the case's edits."""
    inventory = folder / "inventory"
    shutil.copytree(SHIPPED, inventory)
    for edit in case["edits"]:
        _apply(edit, inventory)
    return inventory


def _apply(edit: Edit, inventory: Path) -> None:
    if "remove" in edit:
        (inventory / edit["remove"]).unlink()
    elif "rename" in edit:
        target = inventory / edit["to"]
        target.parent.mkdir(parents=True, exist_ok=True)
        (inventory / edit["rename"]).rename(target)
    elif "content" in edit:
        path = inventory / edit["file"]
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(edit["content"] * edit.get("times", 1), encoding="utf-8")
    elif kind := edit.keys() & {"fifo", "folder", "link"}:
        path = inventory / str(edit[kind.pop()])  # type: ignore[literal-required]
        path.unlink()
        if "fifo" in edit:
            os.mkfifo(path)
        elif "folder" in edit:
            path.mkdir()
        else:
            path.symlink_to(edit["to"])
    else:
        path = inventory / edit["file"]
        text = path.read_text(encoding="utf-8")
        found = list(re.finditer(re.escape(edit["old"]).replace("\\\n", "(?:[ ;#]+EXAMPLE)?\n"), text))
        if len(found) != 1:
            raise ValueError(f"{path}: not exactly once: {edit['old']!r}")
        path.write_text(text[: found[0].start()] + edit["new"] + text[found[0].end() :], encoding="utf-8")


def opened(vaulted: str) -> str:
    """Vaulted values of these cases are their text in hex, as in `!vault "$ANSIBLE_VAULT;1.1;AES256\\n6162"`."""
    return bytes.fromhex(vaulted.split()[1]).decode()


def told() -> str:
    """What a person reads who validates `inventory` in the current directory: its errors, else its warnings."""
    try:
        findings = validate(Path("inventory"), decrypt=opened)
        warnings = () if findings else inventory_warnings(loaded(Path("inventory"), decrypt=opened))
        return (report(findings) if findings else report(warnings, warnings=True)) + "\n"
    except NoMatchError as error:
        return msg(f"{arg(error)}\n  -> {arg(error.hint)}\n")


def _regenerate() -> None:
    for path in cases():
        with tempfile.TemporaryDirectory() as folder:
            spoil(load(path), Path(folder))
            os.chdir(folder)
            path.with_suffix(".txt").write_text(told(), encoding="utf-8")
            os.chdir(HERE)


if __name__ == "__main__":
    _regenerate()
