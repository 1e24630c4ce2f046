#!/usr/bin/env python3
"""Makes the pictures of docs/pictures from real runs of `provision`: a run, the checklist's page, a site, the flow.

    tools/pictures.py [FOLDER [NAME...]]    NAME is run, checklist, drawing or flow; all of them if none is given

The runs are rehearsals, without a machine for the gateway, so that everybody can make them. In the picture of
the run figures and times are those of that run; the drawing and the flow come out the same each time. The page is a
photograph by Chromium.
"""

from __future__ import annotations

import io
import json
import os
import re
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

ROOT = Path(__file__).resolve().parents[1]
SITE = "coastal"
COLUMNS, ROWS = 80, 30
PAGE = (760, 1000)
"""Pixels of the checklist's page that are shown: its beginning."""
COLOURS = 64
FLOW = {
    "Load": ("the whole inventory,", "checked"),
    "Observe": ("one session a device,", "nothing is changed"),
    "Plan": ("what would change,", "at what cost"),
    "Guard": ("would it cut", "your own way?"),
    "Apply": ("under the device's", "own protection"),
    "Read back": ("the second plan", "has to be empty"),
}
"""The steps of docs/engineers/architecture.md, each in a few words."""
SVG = "http://www.w3.org/2000/svg"


def main() -> None:
    """Make the pictures that are named, or all."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs" / "pictures"
    folder.mkdir(parents=True, exist_ok=True)
    for name in sys.argv[2:] or PICTURES:
        PICTURES[name](folder)


def provision(state: str, *words: str, stdout: int = subprocess.PIPE) -> subprocess.Popen[bytes]:
    """Start a command with a state folder of its own; what it says of its progress is not shown."""
    kept = {
        name: value
        for name, value in os.environ.items()
        if name not in {"NO_COLOR", "LC_ALL", "LANGUAGE", "XDG_STATE_HOME", "ATLANTIS_STATE"}
    }
    environment = kept | {
        "HOME": state,  # so that a picture shows no folder of this machine
        "ATLANTIS_NO_MACHINES": "1",
        "COLUMNS": str(COLUMNS),
        "LANG": "C.UTF-8",
        "TERM": "xterm-256color",
    }
    command = [sys.executable, "-P", "-m", "atlantis_netcfg", *words]
    return subprocess.Popen(
        command, cwd=ROOT, env=environment, stdin=subprocess.DEVNULL, stdout=stdout, stderr=subprocess.DEVNULL
    )


def run(folder: Path) -> None:
    """Draw the last rows of a rehearsal, as a terminal shows them."""
    from rich.console import Console  # noqa: PLC0415 - the other pictures need none
    from rich.text import Text  # noqa: PLC0415

    printed = _at_a_terminal(f"site={SITE}", "--rehearse")
    shown = Text.from_ansi(printed).wrap(Console(width=COLUMNS), COLUMNS)[-ROWS:]
    console = Console(width=COLUMNS, record=True, file=io.StringIO(), force_terminal=True)
    console.print(Text("\n").join(shown))
    title = f"./provision site={SITE} --rehearse"
    _write(folder / "run.svg", console.export_svg(title=title, code_format=_without_fonts(), unique_id="run"))


def _at_a_terminal(*words: str) -> str:
    """What a command that has to end well prints on a terminal."""
    with tempfile.TemporaryDirectory() as state:
        ours, theirs = os.openpty()
        with provision(state, *words, stdout=theirs) as process:
            os.close(theirs)
            printed = b""
            while more := _read(ours):
                printed += more
        os.close(ours)
    if process.returncode != 0:
        sys.exit(f"error: provision {' '.join(words)} has ended with {process.returncode}")
    return printed.decode().replace("\r\n", "\n").rstrip("\n")


def _read(terminal: int) -> bytes:
    try:
        return os.read(terminal, 65536)
    except OSError:  # Linux tells so that nobody has it open any more
        return b""


def _without_fonts() -> str:
    """Return rich's own frame without the fonts that it would fetch from the internet."""
    from rich._export_format import CONSOLE_SVG_FORMAT  # noqa: PLC0415 - rich has no other name for it

    return re.sub(r" *@font-face \{\{.*?\n    \}\}\n", "", CONSOLE_SVG_FORMAT, flags=re.DOTALL)


def drawing(folder: Path) -> None:
    """Draw the site as a rehearsed checklist has found it."""
    from atlantis_netcfg.checklist.report import Document  # noqa: PLC0415 - the flow needs none
    from atlantis_netcfg.checklist.report._svg import drawing_svg  # noqa: PLC0415 - what the page takes

    with tempfile.TemporaryDirectory() as state:
        values = _checklist(state)
    document = Document.model_validate({name: values[name] for name in values if name in Document.model_fields})
    _write(folder / "site.svg", drawing_svg(document))


def _checklist(state: str) -> dict[str, object]:
    """Return the document of a rehearsed checklist; items of people stay open, so it ends with 6."""
    with provision(state, "check", f"site={SITE}", "--rehearse", "--json") as process:
        printed, _ = process.communicate()
    values: dict[str, object] = json.loads(printed)
    return values


def checklist(folder: Path) -> None:
    """Photograph the beginning of the checklist's page."""
    from PIL import Image  # noqa: PLC0415 - only this picture needs it

    with tempfile.TemporaryDirectory() as state:
        _checklist(state)
        (page,) = Path(state).rglob("report.html")
        photo = Path(state) / "page.png"
        words = ["--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--disable-background-networking"]
        size = f"--window-size={PAGE[0]},{PAGE[1]}"
        command = ["chromium", *words, f"--user-data-dir={state}/profile", size, f"--screenshot={photo}", page.as_uri()]
        subprocess.run(command, capture_output=True, check=True)
        with Image.open(photo) as image:
            image.convert("RGB").quantize(COLOURS).save(folder / "checklist.png", optimize=True)


def flow(folder: Path) -> None:
    """Draw the steps that docs/engineers/architecture.md lists."""
    page = (ROOT / "docs" / "engineers" / "architecture.md").read_text(encoding="utf-8")
    text = page.partition("\n## ")[2].partition("\n## ")[0]
    steps = [step.strip() for step in re.findall(r"^\d\. \*\*([A-Z][a-z ]+)\*\*", text, re.MULTILINE)]
    root = ET.Element("svg", {"xmlns": SVG, "viewBox": f"0 0 {len(steps) * 150 + 10} 110", "role": "img"})
    ET.SubElement(root, "title").text = f"How a run flows: {', '.join(steps)}"
    ET.SubElement(root, "rect", {"width": "100%", "height": "100%", "fill": "#ffffff"})
    for number, step in enumerate(steps):
        _draw_step(root, number, step, last=number == len(steps) - 1)
    ET.indent(root)
    _write(folder / "flow.svg", ET.tostring(root, encoding="unicode"))


def _draw_step(root: ET.Element, number: int, step: str, *, last: bool) -> None:
    left = 10 + number * 150
    box = {"x": str(left), "y": "15", "width": "128", "height": "80", "rx": "6", "fill": "#e8f1f8", "stroke": "#1f5f8b"}
    ET.SubElement(root, "rect", box)
    font = {"text-anchor": "middle", "font-family": "sans-serif", "fill": "#111111"}
    for words, top, size in ((f"{number + 1}. {step}", 42, 14), (FLOW[step][0], 65, 10), (FLOW[step][1], 79, 10)):
        place = {"x": str(left + 64), "y": str(top), "font-size": str(size)}
        ET.SubElement(root, "text", {**font, **place}).text = words
    if not last:
        arrow = f"M{left + 130} 55 h16 m-5 -5 l5 5 l-5 5"
        ET.SubElement(root, "path", {"d": arrow, "fill": "none", "stroke": "#1f5f8b", "stroke-width": "2"})


def _write(path: Path, text: str) -> None:
    """Keep the repository's own rules of text files: no blanks at line ends, a line feed at the end."""
    lines = [line.rstrip() for line in text.strip().splitlines()]
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")


PICTURES: dict[str, Callable[[Path], None]] = {
    "run": run,
    "checklist": checklist,
    "drawing": drawing,
    "flow": flow,
}

if __name__ == "__main__":
    main()
