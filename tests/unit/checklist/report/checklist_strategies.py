"""Documents as nobody would write them: any text, any order, rows without items, items without rows."""

from collections.abc import Sequence
from datetime import UTC, datetime, timedelta, timezone
from typing import Any

import checklist_example as made
from hypothesis import strategies as st

from atlantis_netcfg.checklist import report
from atlantis_netcfg.core.events import Verdict

HOSTILE = (
    "<script>alert(1)</script>",
    "</style><img src=http://evil.example/x onerror=alert(1)>",
    "\" onmouseover='alert(1)' x=\"",
    "{{ 7 * 7 }} {% raw %} &amp; &#x3c;",
    "]]> --> <!-- <![CDATA[",
    "url(http://evil.example/y) javascript:alert(1)",
    "שלום \u202egnp.exe\u202c مرحبا",
    "👩\u200d🔧 🚤 ✅ ❌ 日本語 Ωκεανός Атлантида",
    "bell\x07 escape\x1b[31mred\x1b]0;title\x07 null\0 delete\x7f\x9b",
    "one\ntwo\r\nthree\ttab\u2028four\x85five",
    "\ud800 half a pair \udfff \ufffe \uffff",
    "{nb} ⌘⌘ \\( ) \\251",
    "soft\u00adhyphen nobreak\u00a0space zero\u200bwidth bom\ufeff",
    "x" * 10_000,
    " ".join(["word"] * 2_000),
)

SHORT = tuple(words for words in HOSTILE if len(words) < 1000)
_WORDS = st.one_of(st.text(max_size=40), st.sampled_from(SHORT))
_KEYS = st.sampled_from(["sparus", "coastal", "a", "<b>", "", "stray"])
_COLUMNS = st.sampled_from([*made.COLUMNS, "ethernet", "site", "odd <i>"])
_TIMES = st.datetimes(datetime(2020, 1, 1), datetime(2040, 1, 1), timezones=st.just(UTC))  # noqa: DTZ001 - bounds
_LOCAL = _TIMES.map(lambda at: at.astimezone(timezone(timedelta(hours=1))))
_VERDICTS = st.sampled_from(Verdict)


def _maybe(some: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    return st.none() | some


EVIDENCE = st.builds(
    report.Evidence,
    type=st.sampled_from(report.EvidenceType),
    what=_WORDS,
    value=_WORDS,
    at=_maybe(_LOCAL),
    by=_maybe(_WORDS),
    file=_maybe(st.sampled_from([made.PHOTO, "gone.jpg", "<b>.png"])),
    sha256=_maybe(st.sampled_from([made.sha256(made.photo()), "0" * 64])),
)
ITEMS = st.builds(
    report.Item,
    id=_WORDS,
    title=_WORDS,
    vehicle=_maybe(_KEYS),
    location=_KEYS,
    endpoint=_COLUMNS,
    table3=st.booleans(),
    kind=st.sampled_from(report.ItemKind),
    phase=st.sampled_from(report.Phase),
    open=st.booleans(),
    verdict=_VERDICTS,
    message=_WORDS,
    hint=_maybe(_WORDS),
    findings=st.lists(
        st.builds(report.ItemFinding, verdict=_VERDICTS, code=_WORDS, message=_WORDS, hint=_maybe(_WORDS)), max_size=2
    ).map(tuple),
    evidence=st.lists(EVIDENCE, max_size=2).map(tuple),
    at=_maybe(_TIMES),
    seconds=_maybe(st.floats(0, 1e6)),
    override=_maybe(st.builds(report.Override, reason=_WORDS, by=_WORDS, at=_TIMES)),
)
ROWS = st.builds(
    report.Row,
    key=_KEYS,
    name=_WORDS,
    kind=st.sampled_from(["auv", "location", "<i>"]),
    aliases=st.lists(_WORDS, max_size=2).map(tuple),
    table3=st.lists(_COLUMNS, max_size=3, unique=True).map(tuple),
    deviation=_maybe(_WORDS),
    beside=st.lists(_COLUMNS, max_size=2, unique=True).map(tuple),
)
_KINDS = st.sampled_from(["router", "cpe", "gateway", "vehicle", "vpn_server", "site", "partner", "odd"])
_REFERRED = st.lists(_WORDS, max_size=2).map(tuple)
NODES = st.builds(report.DrawnNode, key=_KEYS, label=_WORDS, kind=_KINDS, items=_REFERRED, detail=_WORDS)
LINKS = st.builds(
    report.DrawnLink, a=_KEYS, b=_KEYS, label=_WORDS, kind=st.sampled_from(["vpn", "wifi", "ethernet"]), items=_REFERRED
)
DRAWINGS = st.builds(
    report.Drawing, nodes=st.lists(NODES, max_size=5).map(tuple), links=st.lists(LINKS, max_size=6).map(tuple)
)
CHANGES = st.builds(report.ItemChange, id=_WORDS, before=_maybe(_VERDICTS), after=_maybe(_VERDICTS), message=_WORDS)


@st.composite
def documents(draw: st.DrawFn) -> report.Document:
    rows = draw(st.lists(ROWS, max_size=3, unique_by=lambda row: (row.key, row.kind == "location")))
    return made.example(
        run=draw(_WORDS),
        site=draw(_WORDS),
        title=draw(_WORDS),
        rehearsed=draw(st.booleans()),
        tool=draw(_WORDS),
        started=draw(_TIMES),
        ended=draw(_maybe(_TIMES)),
        scope=draw(st.dictionaries(st.sampled_from(["vehicle", "endpoint"]), st.tuples(_WORDS), max_size=2)),
        columns=draw(st.sampled_from([made.COLUMNS, (), ("wifi",)])),
        rows=tuple(rows),
        items=tuple(draw(st.lists(ITEMS, max_size=5))),
        left_out=tuple(draw(st.lists(st.builds(report.LeftOut, what=_WORDS, why=_WORDS), max_size=2))),
        notes=tuple(draw(st.lists(_WORDS, max_size=2))),
        not_rehearsed=tuple(draw(st.lists(_WORDS, max_size=2))),
        broken=tuple(draw(st.lists(_WORDS, max_size=2))),
        drawing=draw(DRAWINGS),
        since_green=draw(
            _maybe(
                st.builds(report.SinceGreen, run=_WORDS, at=_TIMES, changes=st.lists(CHANGES, max_size=2).map(tuple))
            )
        ),
        signed=draw(st.sampled_from([None, made.signature()])),
    )


def hostile(every: Sequence[str] = HOSTILE) -> report.Document:
    """Everything that people and devices can write, in every place where they can."""
    items = [
        made.item(
            f"sparus/wifi/{number}",
            Verdict.FAIL,
            words,
            title=words,
            hint=words,
            findings=(
                report.ItemFinding(verdict=Verdict.FAIL, code="code", message=f"{words} again", hint=f"other {words}"),
            ),
            evidence=(
                report.Evidence(type=report.EvidenceType.CONFIRMED, what=words, value=words, by=words, at=made.AT),
                report.Evidence(type=report.EvidenceType.FILE, what=words, value=words, file=words, sha256="0" * 64),
            ),
            override=report.Override(reason=words, by=words, at=made.AT) if number % 2 else None,
        )
        for number, words in enumerate(every)
    ]
    short = [words for words in every if len(words) < 1000]
    nodes = [report.DrawnNode(key=words, label=words, kind="vehicle", detail=words) for words in short]
    links = [
        report.DrawnLink(a=words, b=short[0], label=words, kind="wifi", items=("sparus/wifi/0",)) for words in short
    ]
    return made.example(
        items=tuple(items),
        title="".join(short),
        run=short[0],
        broken=tuple(short),
        notes=tuple(short),
        not_rehearsed=tuple(short),
        left_out=tuple(report.LeftOut(what=words, why=words) for words in short),
        drawing=report.Drawing(nodes=tuple(nodes), links=tuple(links)),
    )
