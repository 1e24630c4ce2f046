"""The pictures of docs/pictures are those of the program as it is: made again, they say the same."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
from house_checkout import ROOT
from PIL import Image

PICTURES = ROOT / "docs" / "pictures"
LARGEST = 200_000
SATCOM = ("satcom-round-trips.svg", "satcom-received.svg")
"""Of `make satcom`."""
AGAIN = "they are not those of this program any more; type: make pictures"


def make(folder: Path, *names: str) -> None:
    command = [sys.executable, "-P", str(ROOT / "tools" / "pictures.py"), str(folder), *names]
    subprocess.run(command, check=True, capture_output=True)


def words(picture: Path) -> str:
    """All that an SVG says, without its figures: those are of one run."""
    texts = re.findall(r"<text[^>]*>([^<]*)</text>", picture.read_text(encoding="utf-8"))
    return re.sub(r"[\d.]+", "#", " ".join(" ".join(texts).split()))


def test_flow_picture_is_up_to_date(tmp_path: Path) -> None:
    make(tmp_path, "flow")
    assert (tmp_path / "flow.svg").read_text() == (PICTURES / "flow.svg").read_text(), AGAIN


def test_picture_of_an_emulated_link_says_so() -> None:
    for name in SATCOM:
        assert "EMULATED link" in words(PICTURES / name)


@pytest.mark.slow
def test_site_drawing_is_up_to_date(tmp_path: Path) -> None:
    make(tmp_path, "drawing")
    assert (tmp_path / "site.svg").read_text() == (PICTURES / "site.svg").read_text(), AGAIN


@pytest.mark.slow
def test_run_picture_matches_a_real_run(tmp_path: Path) -> None:
    make(tmp_path, "run")
    assert words(tmp_path / "run.svg") == words(PICTURES / "run.svg"), AGAIN
    assert len(words(PICTURES / "run.svg")) > 500


def test_pictures_are_small_used_and_self_contained() -> None:
    found = {path.name: path for path in PICTURES.iterdir()}
    assert found.keys() == {"run.svg", "checklist.png", "site.svg", "flow.svg", *SATCOM}
    assert [name for name, path in found.items() if path.stat().st_size > LARGEST] == []
    pages = "".join(path.read_text() for path in (ROOT / "README.md", *ROOT.glob("docs/**/*.md")))
    assert [name for name in found if f"pictures/{name})" not in pages] == []
    for name in ("run.svg", "site.svg", "flow.svg", *SATCOM):
        text = found[name].read_text()
        assert re.search(r"""url\(['"]?\w+:|href=|@import|<script""", text) is None
    with Image.open(found["checklist.png"]) as image:
        assert (image.format, image.width) == ("PNG", 760)
