"""Hypothesis strategies for export text."""

from hypothesis import strategies as st

from atlantis_netcfg.routeros.rsc import Export, Statement
from atlantis_netcfg.routeros.rsc._model import FLAGS, VERBS

__all__ = ["exports", "statements", "values"]

_LETTERS = "abcdefghijklmnopqrstuvwxyz"

values = st.one_of(
    st.binary(max_size=120).map(lambda raw: raw.decode("utf-8", "surrogateescape")),
    st.text(max_size=200).filter(lambda text: not any("\ud800" <= char <= "\udfff" for char in text)),
    st.text(alphabet="ab \\\"$?\r\n_-=;[]{}()'", max_size=200),
    st.sampled_from(("", "yes", "192.0.2.0/24", "!established,related", ",".join(f"mcs-{n}" for n in range(24)))),
)
"""Any string of bytes that a device can hold, seldom and often needing quotes, escapes and cuts."""

_word = st.text(alphabet=_LETTERS + "-", min_size=1, max_size=12).map(lambda word: f"x{word}")
_menus = st.lists(_word, max_size=3).map(lambda words: "/" + "/".join(words))
_names = st.lists(_word, min_size=1, max_size=2).map(".".join)
_pairs = st.tuples(_names, values)
_unset = st.tuples(_names, st.none())
_flags = st.tuples(st.sampled_from(sorted(FLAGS)), st.just(""))
_arguments = st.lists(st.one_of(_pairs, _pairs, _unset, _flags), max_size=8).map(tuple)
_comments = st.lists(st.text(alphabet=_LETTERS + '#\\"= ', max_size=90).map(str.rstrip), max_size=3).map(tuple)
_verbs = st.sampled_from(sorted(VERBS - {"add"}))
_targets = st.text(alphabet=_LETTERS + " \n*0,$", min_size=1, max_size=90)


@st.composite
def statements(draw: st.DrawFn) -> Statement:
    rows = st.sampled_from(("none", "find", "target"))
    verb = draw(st.one_of(st.just("add"), _verbs))
    kind = "none" if verb == "add" else draw(rows)
    return Statement(
        menu=draw(_menus),
        verb=verb,
        values=draw(_arguments if kind != "none" or verb == "add" else st.lists(_pairs, max_size=4).map(tuple)),
        find=draw(st.lists(_pairs, max_size=3).map(tuple)) if kind == "find" else None,
        target=draw(_targets) if kind == "target" else None,
        comments=draw(_comments),
    )


@st.composite
def exports(draw: st.DrawFn) -> Export:
    rows = tuple(draw(st.lists(statements(), max_size=5)))
    menus: dict[str, None] = {}
    for row in rows:
        for menu in (*draw(st.lists(_menus, max_size=2)), row.menu):
            menus.setdefault(menu)
    return Export(header=draw(_comments), statements=rows, menus=tuple(menus), trailer=draw(_comments))
