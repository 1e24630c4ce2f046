"""What a person is shown of a measured link: screen, page, paper and plots, of one run and of several."""

import json
import re
import subprocess
import xml.etree.ElementTree as ET
from datetime import timedelta
from html.parser import HTMLParser
from pathlib import Path

import pytest
from example_runs import BEGUN, idle_text, measured_run, put_run, samples_text
from hints_said import advised

from atlantis_netcfg.cli import main
from atlantis_netcfg.core import printable
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.links.qualify.compare import FigureTrend, compare_runs
from atlantis_netcfg.links.qualify.grids import SHAPE_UNKNOWN
from atlantis_netcfg.links.qualify.measured_run import MeasuredRun
from atlantis_netcfg.links.qualify.record import QualifyRecord, make_record
from atlantis_netcfg.links.qualify.samples import read
from atlantis_netcfg.records.qualify import write_pages
from atlantis_netcfg.records.qualify.pages import html, pdf, rows
from atlantis_netcfg.records.qualify.plots import WIDTH, Plot, plots
from atlantis_netcfg.records.qualify.sections import EMULATED_NOTICE, format_seconds, sections
from atlantis_netcfg.records.qualify.several import comparison_rows

SVG = "{http://www.w3.org/2000/svg}"
HOSTILE = "EXAMPLE\x1b[2J<script>alert(1)</script>\u202e"


def drawn(text: str, run: MeasuredRun | None = None) -> tuple[QualifyRecord, list[Plot]]:
    samples = [*read(text.splitlines(keepends=True))]
    record = make_record(run or measured_run(), samples)
    return record, plots(record, samples)


def screen(record: QualifyRecord) -> list[str]:
    return [printable.plain(row) for row in rows(record, "/EXAMPLE/kept")]


def test_a_screen_shows_every_section_within_eighty_columns() -> None:
    record, _ = drawn(samples_text())
    lines = screen(record)
    assert [line for line in lines if len(line.rstrip()) > 80] == []
    text = "\n".join(lines)
    for section in sections(record):
        assert section.title in lines
    assert EMULATED_NOTICE in lines
    assert re.search(r"^  PASS +FTD, round trip, 95 %: \d+ ms, limit 1500 ms", text, re.MULTILINE)
    assert re.search(r"^  640x480 q60 +2 .* 326\.0 FAIL: loss", text, re.MULTILINE)
    assert re.search(r"^  160x120 q30 +24\.7 Hz +the queue grows +proved +179\.8 MB/h", text, re.MULTILINE)
    assert "the traffic used this link" in re.sub(r"\s+", " ", text)


@pytest.mark.usefixtures("portuguese")
def test_portuguese_screen_fits_80_columns() -> None:
    assert [line for line in screen(drawn(samples_text())[0]) if len(line.rstrip()) > 80] == []


@pytest.mark.parametrize(
    ("way", "words"),
    [
        (Verdict.FAIL, "the traffic used another link"),
        (Verdict.INCONCLUSIVE, "it is not proved that the traffic used this link"),
    ],
)
def test_unproved_route_is_shown(way: Verdict, words: str) -> None:
    record, _ = drawn(idle_text(), measured_run(way=way, way_reason="EXAMPLE"))
    last = re.sub(r"\s+", " ", " ".join(screen(record)[-3:]))
    assert f"{way.value}: 7 of 8 criteria" in last
    assert words in last


def test_run_without_round_trips_is_inconclusive() -> None:
    record, shown = drawn("", measured_run(ended=None, reason="stopped"))
    text = "\n".join(screen(record))
    assert shown == []
    assert "No round trips were measured." in text
    assert "INCONCLUSIVE: no criterion was checked" in text


class _Page(HTMLParser):
    """The tags of a page, and what they refer to."""

    def __init__(self) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.attributes: list[tuple[str, str | None]] = []
        self.headings: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += attrs

    def handle_data(self, data: str) -> None:
        if self.tags and self.tags[-1] in {"h1", "h2"} and data.strip():
            self.headings.append(data.strip())


def test_page_is_complete_and_self_contained() -> None:
    record, shown = drawn(samples_text())
    text = html(record, shown).decode()
    page = _Page()
    page.feed(text)
    assert page.headings == ["Measured link: satellite of coastal", *(section.title for section in sections(record))]
    assert {"script", "link", "img", "iframe"} & {*page.tags} == set()
    names = {name for name, _ in page.attributes}
    assert {"style", "src", "href", "onload", "onclick"} & names == set(), "its own policy would refuse them"
    assert page.tags.count("svg") == len(shown) == 7
    assert page.tags.count("figure") == 7
    assert text.count(SHAPE_UNKNOWN) == 2, "beside each of the two tables"
    assert text.count("EMULATED LINK</text>") == 7, "on every figure"
    assert html(record, shown) == text.encode()


def test_a_real_run_is_not_called_emulated() -> None:
    record, shown = drawn(idle_text(), measured_run(emulated=False))
    assert "EMULATED" not in html(record, shown).decode().upper().replace("EMULATED-", "")
    assert not any("emulated" in line.lower() for line in screen(record))


def test_external_text_is_escaped() -> None:
    run = measured_run(remarks=(HOSTILE,), facts={HOSTILE: HOSTILE}, way_reason=HOSTILE)
    record, shown = drawn(idle_text(), run)
    text = html(record, shown).decode()
    assert "<script>" not in text
    assert "\u202e" not in text
    assert "\x1b" not in text


@pytest.mark.usefixtures("portuguese")
def test_a_page_says_its_language() -> None:
    record, shown = drawn(idle_text())
    text = html(record, shown).decode()
    assert '<html lang="pt-PT">' in text
    assert '<th scope="row">satellite</th>' in text, "the name of a link is no word"


def svg(plot: Plot) -> ET.Element:
    return ET.fromstring(plot.svg())  # noqa: S314 - made here


def test_each_plot_has_a_title_a_description_and_units() -> None:
    _, shown = drawn(samples_text())
    assert [plot.name for plot in shown] == [
        *("idle-time", "loaded-time", "shares", "gaps", "loss", "telemetry", "images")
    ]
    for plot in shown:
        root = svg(plot)
        assert root.findtext(f"{SVG}title") == plot.title
        assert root.findtext(f"{SVG}desc") == plot.words
        assert "EMULATED LINK" in plot.words
        assert root.findall(f".//{SVG}style") == []
        assert all("style" not in each.attrib for each in root.iter())
        for text in root.iter(f"{SVG}text"):
            assert 0 <= float(text.get("x", "-1")) <= WIDTH
            assert 0 <= float(text.get("y", "-1")) <= plot.height


def test_round_trips_are_plotted_at_the_right_position() -> None:
    record, shown = drawn(idle_text(gap_at_s=40.0))
    assert record.idle is not None
    plot = next(plot for plot in shown if plot.name == "idle-time")
    texts = {each.text: each for each in svg(plot).iter(f"{SVG}text")}
    (values, lost) = [each.get("d", "") for each in svg(plot).iter(f"{SVG}path")]
    zero, half = (float(texts[tick].get("y", "")) for tick in ("0", "0.4"))  # of both axes "0" is the last, of x
    x0, x100 = (float(texts[tick].get("x", "")) for tick in ("0", "100"))
    columns = [(float(x), float(a), float(b)) for x, a, b in re.findall(r"M(\d+),([\d.]+)V([\d.]+)", values)]
    begin, end = ((x - x0) / (x100 - x0) * 100 for x in (min(columns)[0], max(columns)[0]))
    assert begin == pytest.approx(0, abs=0.5)
    assert end == pytest.approx(150, abs=1)
    assert not [x for x, _, _ in columns if x0 + 42 / 100 * (x100 - x0) < x < x0 + 109 / 100 * (x100 - x0)], "the gap"
    ticks = sorted(int(x) for x in re.findall(r"M(\d+),", lost))
    assert ticks[0] == pytest.approx(x0 + 40 / 100 * (x100 - x0), abs=3)
    assert f"no response: {record.idle.loss.lost}, ticks at the top" in texts
    assert zero > half, "more stands above"


def test_bars_show_their_numbers() -> None:
    record, shown = drawn(idle_text(loss=0.03, gap_at_s=40.0))
    assert record.idle is not None
    by_name = {plot.name: plot.words for plot in shown}
    assert "more than 60 s: 1." in by_name["gaps"]
    assert "1 to 5 s: 0." in by_name["gaps"]
    up = record.idle.loss.up
    assert up is not None
    assert f"up, without load: {100 * up / 600:.2f} %." in by_name["loss"]
    assert "down, without load: 0.00 %." in by_name["loss"]


def test_grid_cells_show_verdict_or_not_measured() -> None:
    _, shown = drawn(samples_text())
    plot = next(plot for plot in shown if plot.name == "images")
    assert "640x480 q60 at 2 Hz: FAIL, loss." in plot.words
    texts = [each.text or "" for each in svg(plot).iter(f"{SVG}text")]
    assert texts.count("not measured") == 2
    assert [text for text in texts if text.endswith("FAIL")] == ["✗ FAIL"]


def test_pdf_has_the_same_content_as_the_page(tmp_path: Path) -> None:
    place = put_run(tmp_path)
    record = write_pages(place)
    assert {path.name for path in place.iterdir()} == {
        *("run.json", "samples.jsonl", "record.json", "page.html", "page.pdf")
    }
    found = subprocess.run(
        ["pdftotext", "-layout", place / "page.pdf", "-"], capture_output=True, text=True, check=True
    )
    text = re.sub(r"\s+", " ", found.stdout)
    for section in sections(record):
        assert section.title in text
    assert text.count("Only the titles of Tables 33 and 34 of the report are known") == 2
    pages = found.stdout.split("\f")[:-1]
    assert all("EMULATED LINK" in page for page in pages), "a page that was torn off is known as well"
    assert text.count("EMULATED LINK") >= len(pages) + 7, "and every figure"
    assert "seconds since the first packet" in text
    samples = [*read(samples_text().splitlines(keepends=True))]
    assert pdf(record, plots(record, samples)) == (place / "page.pdf").read_bytes()


def test_two_runs_are_compared() -> None:
    first, _ = drawn(idle_text(), measured_run(emulated=False))
    second, _ = drawn(idle_text(loss=0.03, gap_at_s=40.0), measured_run(link="4g", begun=BEGUN + timedelta(days=1)))
    found = compare_runs(first, second)
    changes = {item.key: item.change for item in found.figures}
    assert changes["rtt_p50"] is FigureTrend.ALIKE
    assert changes["loss_up"] is FigureTrend.WORSE
    assert changes["loss_down"] is FigureTrend.ALIKE
    assert changes["longest_gap"] is FigureTrend.WORSE
    assert changes["goodput_up"] is FigureTrend.UNKNOWN
    assert changes["path_mtu_up"] is FigureTrend.ALIKE
    assert compare_runs(second, first).figures[8].change is FigureTrend.BETTER
    assert found.remarks == (
        "the links differ: satellite and 4g",
        "one of them was measured over an emulated link: it does not apply to a real link",
    )
    assert compare_runs(first, first).remarks == ()
    facts = {item.title: (item.first, item.second) for item in found.facts}
    assert facts["signal"] == ("5 bars", "5 bars")
    assert facts["this computer's clock"] == (
        "unknown whether it is synchronised",
        "unknown whether it is synchronised",
    )


def test_device_facts_are_compared_side_by_side() -> None:
    first, _ = drawn(idle_text(), measured_run(facts={"RSRP": "-90 dBm", "router": "example, RouterOS 7.18.2"}))
    second, _ = drawn(idle_text(), measured_run(facts={"RSRP": "-101 dBm"}, clock_synchronised=True))
    lines = "\n".join(printable.plain(row) for row in comparison_rows(first, second, compare_runs(first, second)))
    assert "RSRP: A: -90 dBm; B: -101 dBm" in lines
    assert "router: A: example, RouterOS 7.18.2; B: unknown" in lines
    assert "this computer's clock: A: unknown whether it is synchronised; B: synchronised" in lines
    assert "tool: 0.0.0\n" in lines


@pytest.fixture
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("ATLANTIS_STATE", str(tmp_path / "state"))
    return tmp_path / "state"


OLD, NEW = "satellite-20261120T093000Z", "satellite-20261121T093000Z"


def two_runs(state: Path) -> None:
    folder = state / "real" / "coastal" / "qualify"
    put_run(folder, measured_run(id=OLD, emulated=False))
    later = BEGUN + timedelta(days=1)
    put_run(folder, measured_run(id=NEW, emulated=False, begun=later), idle_text(loss=0.05))


def test_show_passes_only_when_every_criterion_does(state: Path, capsys: pytest.CaptureFixture[str]) -> None:
    two_runs(state)
    assert main(["measure", "show", "site=coastal", f"run={OLD}"]) == 0
    assert "PASS: 8 of 8 criteria of `satellite` are met" in capsys.readouterr().out
    assert main(["measure", "show", "site=coastal", "--json"]) == 6, "the newest one has lost 5 %"
    found = json.loads(capsys.readouterr().out)
    assert found["record"]["run"]["id"] == NEW
    assert (found["exit"], found["record"]["verdict"]) == (6, "FAIL")
    assert main(["measure", "show", "site=coastal", f"run={OLD}", "--thresholds", "wifi", "--json"]) == 6
    assert json.loads(capsys.readouterr().out)["record"]["thresholds_name"] == "wifi"


def test_compare_and_history(state: Path, capsys: pytest.CaptureFixture[str]) -> None:
    two_runs(state)
    assert main(["measure", "compare", "site=coastal", f"run={OLD},{NEW}"]) == 0
    out = capsys.readouterr().out
    assert [line for line in out.splitlines() if len(line) > 80] == []
    assert re.search(r"^loss up +0\.00 % +\d\.\d\d % +worse$", out, re.MULTILINE)
    assert main(["measure", "compare", "site=coastal", f"run={OLD},{NEW}", "--json"]) == 0
    assert [item["key"] for item in json.loads(capsys.readouterr().out)["figures"]][:2] == ["rtt_p50", "rtt_p95"]
    assert main(["measure", "history", "site=coastal"]) == 0
    out = capsys.readouterr().out
    assert [line for line in out.splitlines() if len(line) > 80] == []
    assert [line.split()[0] for line in out.splitlines() if "satellite-" in line] == ["PASS", "FAIL"]
    assert main(["measure", "history", "site=coastal", "link=satellite", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["runs"]
    assert [(item["run"], item["verdict"]) for item in found] == [(OLD, "PASS"), (NEW, "FAIL")]


@pytest.mark.parametrize(
    ("line", "code", "words"),
    [
        ("show site=coastal", 7, "`coastal` has no real measurement"),
        ("history site=coastal", 7, "`coastal` has no real measurement"),
        ("show site=coastal run=EXAMPLE", 7, "coastal has no measurement `EXAMPLE`"),
        ("show site=coastal run=EXAMPLE link=4g", 3, "`run=` and `link=` cannot be used together"),
        ("compare site=coastal run=EXAMPLE", 3, "exactly two measurements are needed, not 1"),
        ("show site=../EXAMPLE", 3, "` is not a valid site name"),
        ("show site=coastal --thresholds EXAMPLE", 3, "unknown threshold profile `EXAMPLE`"),
    ],
)
def test_mistakes_are_reported(
    line: str, code: int, words: str, state: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["measure", *line.split()]) == code
    printed = capsys.readouterr()
    assert words in printed.err
    assert printed.out == ""
    assert not state.exists() or not [*state.rglob("run.json")]


@pytest.mark.parametrize("more", [(), ("--rehearse",)])
@pytest.mark.parametrize(
    "line", ["show site=coastal run=EXAMPLE", f"show site=coastal run={OLD}X", "compare site=coastal run=EXAMPLE"]
)
def test_advised_commands_work(
    line: str, more: tuple[str, ...], state: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put_run(state / ("rehearsal" if more else "real") / "coastal" / "qualify", measured_run(id=OLD), "")
    assert main(["measure", *line.split(), *more]) != 0
    (words,) = advised(capsys.readouterr().err)
    assert main(words) == 0
    assert OLD in capsys.readouterr().out


def test_other_kind_of_runs_is_only_mentioned(state: Path, capsys: pytest.CaptureFixture[str]) -> None:
    put_run(state / "rehearsal" / "coastal" / "qualify", None, "")
    assert main(["measure", "show", "site=coastal"]) == 7
    assert "`--rehearse` shows rehearsed measurements" in capsys.readouterr().err
    assert main(["measure", "history", "site=coastal", "link=4g", "--rehearse"]) == 7
    assert "links with measurements: satellite" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("value", "words"), [(0.0008, "0.8 ms"), (0.0104, "10 ms"), (0.596, "596 ms"), (9.0, "9000 ms"), (70.1, "70.1 s")]
)
def test_seconds_are_formatted(value: float, words: str) -> None:
    assert format_seconds(value) == words
