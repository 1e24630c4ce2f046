"""Screen, page and paper say of each value where it is from; a reader that we did not write reads the QR codes."""

import re
import subprocess
from pathlib import Path

import pytest
from asbuilt_examples import AT, GATEWAY, away, port, record, router, terminal
from PIL import Image

from atlantis_netcfg.core import printable
from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.inventory.model import AsBuilt
from atlantis_netcfg.records.asbuilt.pages import html, rows
from atlantis_netcfg.records.asbuilt.pdf import labels_of, labels_pdf, pdf
from atlantis_netcfg.records.asbuilt.record import Fact, Origin, compare

DIGEST = "0123456789abcdef" * 4
PLACE = "real/coastal/asbuilt/20261125T100000Z"
HOSTILE = "EXAMPLE\x1b[2J<script>alert(1)</script>\u202e"
DPI = 300
SECRETS = re.compile(r"\d{15}|SHA256:|PRIVATE|password|psk", re.IGNORECASE)


def screen(*devices: object, **more: object) -> list[str]:
    made = record(*devices, **more)  # type: ignore[arg-type] # devices
    return [printable.plain(row) for row in rows(made, "/EXAMPLE/kept")]


def test_screen_shows_the_source_of_each_value() -> None:
    found = screen(router("EXAMPLE1", port(neighbours=(GATEWAY,))), terminal())
    assert found[:3] == [
        "As built: Coastal testbed (coastal)",
        "record 20261125T100000Z, 2026-11-25 10:00 WET (10:00 UTC)",
        "nothing was changed",
    ]
    text = "\n".join(found)
    assert "  serial number           EXAMPLE1 (read in this run)" in text
    assert "software version        1.2 (declared: EXAMPLE-person has seen it on its pages)" in re.sub(
        r"\n +", " ", text
    )
    assert "not read: no documented interface for programs" in re.sub(r"\n +", " ", text)
    assert "neighbour: 02:00:5E:00:00:07 10.64.1.7 (coastal-gateway), from bridge and ARP" in re.sub(r"\n +", " ", text)
    assert found[-1] == "1 of 2 devices were read, 1 cannot be queried"


def test_screen_marks_last_known_values_of_unreachable_devices() -> None:
    made = compare(record(away(), id="20261126T100000Z"), record())
    text = re.sub(r"\n +", " ", "\n".join(printable.plain(row) for row in rows(made, "kept")))
    assert "coastal-router: router, NOT REACHED" in text
    assert "its last known values, read on 2026-11-25 10:00 WET (10:00 UTC)" in text
    assert "EXAMPLE1 (stored on 2026-11-25 10:00 WET (10:00 UTC))" in text
    assert "0 of 1 devices were read, 1 did not respond" in text


def test_screen_fits_80_columns() -> None:
    found = screen(router("EXAMPLE1", port(neighbours=(GATEWAY,))), terminal(), away(name="coastal-cpe"))
    assert [line for line in found if len(line) > 80] == []


def test_differences_appear_on_screen_page_and_pdf() -> None:
    made = compare(record(router("EXAMPLE2"), id="20261126T100000Z"), record())
    told = "coastal-router: serial number changed from EXAMPLE1 to EXAMPLE2"
    assert f"  ~ {told}" in [printable.plain(row) for row in rows(made, "kept")]
    assert told in html(made, DIGEST).decode()
    assert told in re.sub(r"\s+", " ", text_of(pdf(made, DIGEST)))


def test_page_is_self_contained_and_escapes_hostile_device_text() -> None:
    page = html(record(router(HOSTILE), terminal()), DIGEST).decode()
    assert re.search(r"<script|src=|https?://|url\(|\x1b|\u202e", page) is None
    assert "&lt;script&gt;" in page
    assert 'id="device-coastal-router"' in page
    assert DIGEST in page
    assert html(record(router(HOSTILE), terminal()), DIGEST).decode() == page


def test_rehearsal_is_marked_in_every_output() -> None:
    made = record(rehearsed=True)
    assert "emulated devices; no real device was contacted" in [printable.plain(row) for row in rows(made, "kept")]
    assert "REHEARSAL: no real device was contacted." in html(made, DIGEST).decode()
    assert "REHEARSAL: no real device was contacted." in text_of(pdf(made, DIGEST))
    assert all("(REHEARSED)" in label.text for label in labels_of(made, DIGEST, PLACE))


@pytest.mark.usefixtures("portuguese")
def test_data_stays_english_in_portuguese() -> None:
    made = record()
    assert '<html lang="pt-PT">' in html(made, DIGEST).decode()
    assert made.as_json()["devices"][0]["state"] == "read"
    assert labels_of(made, DIGEST, PLACE)[0].text.startswith("ATLANTIS as built")


def text_of(data: bytes) -> str:
    done = subprocess.run(["pdftotext", "-layout", "-", "-"], input=data, capture_output=True, check=True)
    return done.stdout.decode()


def codes(folder: Path, data: bytes, sheet: AsBuilt) -> list[str]:
    """Every label of a sheet as zbar reads it, each photographed alone, as a telephone does."""
    (folder / "labels.pdf").write_bytes(data)
    subprocess.run(["pdftoppm", "-r", str(DPI), "-gray", "-png", "labels.pdf", "page"], cwd=folder, check=True)
    columns, lines = int(210.01 // sheet.label_width_mm), int(297.01 // sheet.label_height_mm)
    left = (210 - columns * sheet.label_width_mm) / 2
    top = (297 - lines * sheet.label_height_mm) / 2
    found = []
    for number, path in enumerate(sorted(folder.glob("page-*.png"))):
        with Image.open(path) as image:
            for place in range(columns * lines):
                x = left + place % columns * sheet.label_width_mm
                y = top + place // columns * sheet.label_height_mm
                box = [round(part * DPI / 25.4) for part in (x, y, x + sheet.label_width_mm, y + sheet.label_height_mm)]
                label = image.crop((box[0], box[1], min(box[2], image.width), min(box[3], image.height)))
                if label.convert("L").getextrema() == (255, 255):
                    continue
                label.save(folder / f"label-{number}-{place}.png")
                found.append(_decoded(folder / f"label-{number}-{place}.png"))
    return found


def _decoded(path: Path) -> str:
    command = ["zbarimg", "--quiet", "--raw", "--nodbus", "-Sdisable", "-Sqrcode.enable", str(path)]
    return subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip()


@pytest.mark.parametrize("size", [(70.0, 36.0), (99.1, 67.7)])
def test_zbar_decodes_the_expected_text_of_each_label(tmp_path: Path, size: tuple[float, float]) -> None:
    sheet = AsBuilt(label_width_mm=size[0], label_height_mm=size[1])
    ports = [
        port(f"ether{number}", belongs="link satellite: coastal-sat, power for coastal-sat") for number in range(1, 9)
    ]
    made = record(router("EXAMPLE1", *ports), terminal(), rehearsed=True)
    expected = [label.text for label in labels_of(made, DIGEST, PLACE)]
    assert len(expected) == 10
    assert codes(tmp_path, labels_pdf(made, DIGEST, PLACE, sheet), sheet) == expected


def test_label_code_refers_to_the_record_and_contains_no_secret() -> None:
    numbers = {"imei": "001017000001234", "iccid": "8900101000000000000", "host_key": "SHA256:" + "A" * 43}
    secret = {name: Fact(value=value, origin=Origin.READ, at=AT) for name, value in numbers.items()}
    made = record(router(facts={**router().facts, **secret}))
    box, label = labels_of(made, DIGEST, PLACE)
    assert box.text == (
        "ATLANTIS as built\ncoastal: coastal-router\nserial EXAMPLE1\nrecord 20261125T100000Z\n"
        "sha256 0123456789abcdef\nreal/coastal/asbuilt/20261125T100000Z/as-built.html#device-coastal-router"
    )
    assert "port ether3: LAN of the site" in label.text.splitlines()
    assert [text for text in (box.text, label.text) if SECRETS.search(text)] == []
    assert "://" not in label.text


def test_extra_labels_continue_on_a_second_sheet() -> None:
    ports = [port(f"ether{number}") for number in range(1, 31)]
    data = labels_pdf(record(router("EXAMPLE1", *ports)), DIGEST, PLACE, AsBuilt())
    assert len(re.findall(rb"/Type /Page\b", data)) == 2


def test_label_too_small_for_its_code_is_refused_with_the_required_size() -> None:
    with pytest.raises(UsageError, match="labels of 40 by 25 mm are too small for their QR codes") as caught:
        labels_pdf(record(), DIGEST, PLACE, AsBuilt(label_width_mm=40.0, label_height_mm=25.0))
    needed = re.findall(r"`(label_\w+)` (\d+)", caught.value.hint or "")
    sizes = {name: float(value) for name, value in needed}
    assert sizes.keys() == {"label_width_mm", "label_height_mm"}
    assert labels_pdf(record(), DIGEST, PLACE, AsBuilt.model_validate(sizes))
