import pytest
from hypothesis import given
from hypothesis import strategies as st
from librouteros.protocol import encode_length as peer_length
from librouteros.protocol import encode_sentence as peer_sentence

from atlantis_netcfg.emulator.routeros.wire import connection

LIMIT = 1 << 33
WORDS = st.lists(st.text(st.characters(exclude_categories=["Cs"]), min_size=1, max_size=300), min_size=1, max_size=6)


@given(st.lists(WORDS, max_size=4))
def test_sentences_survive_encoding_and_decoding(sentences: list[list[str]]) -> None:
    wire = b"".join(peer_sentence(*words, encoding="utf-8") for words in sentences)
    assert wire == b"".join(map(connection.encode_sentence, sentences))
    assert list(connection.Decoder(LIMIT).feed(wire)) == [tuple(words) for words in sentences]


@given(st.lists(WORDS, max_size=3))
def test_bytes_may_come_one_by_one(sentences: list[list[str]]) -> None:
    wire = b"".join(peer_sentence(*words, encoding="utf-8") for words in sentences)
    decoder = connection.Decoder(LIMIT)
    heard = [words for byte in wire for words in decoder.feed(bytes([byte]))]
    assert heard == [tuple(words) for words in sentences]


@given(st.integers(0, 0x0FFF_FFFF))
def test_lengths_match_the_peer_encoding(length: int) -> None:
    assert connection.encode_length(length) == peer_length(length)


@pytest.mark.parametrize("length", [0x7F, 0x80, 0x3FFF, 0x4000, 0x1F_FFFF, 0x20_0000])
def test_words_at_length_form_boundaries(length: int) -> None:
    word = "x" * length
    assert list(connection.Decoder(LIMIT).feed(connection.encode_sentence([word]))) == [(word,)]


def test_five_byte_lengths() -> None:
    assert connection.encode_length(0x1000_0000) == b"\xf0\x10\x00\x00\x00"
    assert list(connection.Decoder(LIMIT).feed(b"\xf0\x00\x00\x00\x03abc\0")) == [("abc",)]


def test_overlong_length_forms_are_accepted() -> None:
    assert list(connection.Decoder(LIMIT).feed(b"\xc0\x00\x02/x\x80\x00")) == [("/x",)]


def test_no_sentence_before_the_zero_length_word() -> None:
    decoder = connection.Decoder(LIMIT)
    assert list(decoder.feed(b"\x02/x\x02=a")) == []
    assert list(decoder.feed(b"\0")) == [("/x", "=a")]


def test_empty_sentences_are_ignored() -> None:
    assert list(connection.Decoder(LIMIT).feed(b"\0\0\x02/x\0\0\0")) == [("/x",)]


@pytest.mark.parametrize("first", range(0xF8, 0x100))
def test_reserved_control_byte_ends_decoding_after_earlier_sentences(first: int) -> None:
    sentences = connection.Decoder(LIMIT).feed(b"\x02/x\0" + bytes([first]))
    assert next(sentences) == ("/x",)
    with pytest.raises(connection.ReservedLength):
        next(sentences)


def test_oversized_word_is_refused_before_it_arrives() -> None:
    with pytest.raises(connection.WordTooLong):
        list(connection.Decoder(1024).feed(connection.encode_length(1025)))


def test_invalid_utf8_bytes_round_trip() -> None:
    (words,) = connection.Decoder(LIMIT).feed(b"\x05=n=\xe9\xff\0")
    assert connection.encode_sentence(words) == b"\x05=n=\xe9\xff\0"
