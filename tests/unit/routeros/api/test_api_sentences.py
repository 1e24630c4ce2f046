import pytest
from hypothesis import given
from hypothesis import strategies as st

from atlantis_netcfg.routeros.api._wire import (
    MAX_SENTENCE,
    AnswerReader,
    Decoder,
    GarbageError,
    encode,
    encode_size,
    parse,
)

words = st.binary(min_size=1, max_size=300).map(lambda raw: raw.decode("utf-8", "surrogateescape"))
sentences = st.lists(st.lists(words, min_size=1, max_size=6).map(tuple), max_size=6)


@given(sentences, st.lists(st.integers(min_value=1, max_value=400), max_size=40))
def test_sentences_survive_however_the_stream_is_cut(sent: list[tuple[str, ...]], cuts: list[int]) -> None:
    stream = b"\0".join(map(encode, sent))
    decoder = Decoder()
    received: list[tuple[str, ...]] = []
    for size in [*cuts, len(stream)]:
        chunk, stream = stream[:size], stream[size:]
        received += decoder.feed(chunk)
    assert received == sent
    assert decoder.is_between


@given(sentences)
def test_sentences_survive_byte_by_byte(sent: list[tuple[str, ...]]) -> None:
    decoder = Decoder()
    received = [words for byte in b"".join(map(encode, sent)) for words in decoder.feed(bytes([byte]))]
    assert received == sent


@pytest.mark.parametrize("size", [0x7F, 0x80, 0x3FFF, 0x4000, 0x1FFFFF, 0x200000])
def test_words_at_length_encoding_limits_survive(size: int) -> None:
    sentence = ("!re", "x" * size)
    assert Decoder().feed(encode(sentence)) == [sentence]


@pytest.mark.parametrize(
    ("size", "prefix"),
    [
        (0, b"\0"),
        (0x7F, b"\x7f"),
        (0x80, b"\x80\x80"),
        (0x3FFF, b"\xbf\xff"),
        (0x4000, b"\xc0\x40\x00"),
        (0x1FFFFF, b"\xdf\xff\xff"),
        (0x200000, b"\xe0\x20\x00\x00"),
        (0xFFFFFFF, b"\xef\xff\xff\xff"),
        (0x10000000, b"\xf0\x10\x00\x00\x00"),
        (0xFFFFFFFF, b"\xf0\xff\xff\xff\xff"),
    ],
)
def test_length_encoding_matches_the_manual(size: int, prefix: bytes) -> None:
    assert encode_size(size) == prefix


def test_five_byte_length_is_decoded() -> None:
    assert Decoder().feed(b"\xf0\x00\x00\x00\x05!done\0") == [("!done",)]
    patient = Decoder(limit=0x20000000)
    assert patient.feed(b"\xf0\x10\x00\x00\x00!done") == []
    assert not patient.is_between


@pytest.mark.parametrize(
    "prefix", [encode_size(MAX_SENTENCE + 1), b"\xf0\x10\x00\x00\x00", b"\x03!re" + encode_size(MAX_SENTENCE)]
)
def test_huge_length_is_refused_before_buffering(prefix: bytes) -> None:
    with pytest.raises(
        GarbageError, match=r"^a word of \d+ bytes, where 16777216 bytes are the most for a whole answer$"
    ):
        Decoder().feed(prefix)


@pytest.mark.parametrize("first", [0xF1, 0xF7, 0xF8, 0xFF])
def test_invalid_first_length_byte_is_refused(first: int) -> None:
    with pytest.raises(
        GarbageError, match=rf"^a word that starts with the byte 0x{first:x}, which no length starts with$"
    ):
        Decoder().feed(bytes([first]))


def test_non_utf_8_bytes_round_trip() -> None:
    ((word,),) = Decoder().feed(b"\x03\xd2\xd2\xca\0")
    assert encode((word,)) == b"\x03\xd2\xd2\xca\0"


@pytest.mark.parametrize(
    ("words", "answer"),
    [
        (
            ("!re", ".tag=3", "=.id=*1", "=comment=a=b", "=name="),
            AnswerReader("!re", "3", {".id": "*1", "comment": "a=b", "name": ""}),
        ),
        (("!done", "=ret=*1F", ".tag=4"), AnswerReader("!done", "4", {"ret": "*1F"})),
        (("!empty", ".tag=5"), AnswerReader("!empty", "5", {})),
        (("!re", ".tag=6", ".news=1"), AnswerReader("!re", "6", {})),
        (
            ("!fatal", "session terminated on request"),
            AnswerReader("!fatal", None, {}, "session terminated on request"),
        ),
        (("!fatal", "a\x1b[2J" + "b" * 900), AnswerReader("!fatal", None, {}, "a [2J" + "b" * 195)),
    ],
)
def test_replies_are_parsed(words: tuple[str, ...], answer: AnswerReader) -> None:
    assert parse(words) == answer


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (("SSH-2.0-ROSSSH",), "a word of 14 characters in the place of an answer"),
        (("!nonsense",), "`!nonsense` in the place of an answer"),
        (("!\x1b[2J",), "a word of 5 characters in the place of an answer"),
        (("!re", "password secret"), "a word of 15 characters in the place of an attribute of !re"),
        (("!re", "=name"), "a word of 5 characters in the place of an attribute of !re"),
    ],
)
def test_malformed_reply_is_described_without_its_content(words: tuple[str, ...], complaint: str) -> None:
    with pytest.raises(GarbageError) as caught:
        parse(words)
    assert str(caught.value) == complaint
