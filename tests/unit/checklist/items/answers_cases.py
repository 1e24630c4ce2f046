"""Golden cases: `answers/<case>.yml` is a file of answers, `answers/<case>.txt` exactly what a person is told.

`python tests/unit/checklist/items/answers_cases.py` writes the texts anew: read the difference before you commit it.
"""

import os
import shutil
import tempfile
from pathlib import Path

from checklist_bench import checklist

from atlantis_netcfg.checklist import Answers, AnswersInvalid

FOLDER = Path(__file__).with_name("answers")


def cases() -> list[Path]:
    return sorted(FOLDER.glob("*.yml"))


def told(path: Path, folder: Path) -> str:
    """What somebody reads who gives the file in this folder, in which there are two photos."""
    shutil.copy(path, folder / "answers.yml")
    (folder / "failsafe.jpg").write_bytes(b"a photo")
    (folder / "empty.jpg").touch()
    os.chdir(folder)
    try:
        Answers.read(Path("answers.yml"), checklist())
    except AnswersInvalid as error:
        return f"{error}\n"
    return ""


def _regenerate() -> None:
    for path in cases():
        with tempfile.TemporaryDirectory() as folder:
            path.with_suffix(".txt").write_text(told(path, Path(folder)), encoding="utf-8")
            os.chdir(FOLDER)


if __name__ == "__main__":
    _regenerate()
