"""What every client of the API goes through; the file of each says which program it is and what it calls things."""

from collections.abc import Iterator
from typing import ClassVar

import pytest
from intent import CALLS, MENUS, PINGS, REFUSALS, RULES, TAMPERED, TEXTS, is_put_right, shortfalls
from stand import PRESENT, Stand, stand, text

__all__ = ["Conversation"]

_MANAGEMENT = 'add address=10.64.101.1/24 comment="atlantis: management" interface=ether8\n'


@PRESENT
@pytest.mark.slow
class Conversation:
    """Read, ask, be refused, write: over TLS, with the router's own certificate as the only one that is trusted."""

    client: ClassVar[str]
    version: ClassVar[str] = "7.18.2"
    provisioned: ClassVar[bool] = True
    """By our engine; otherwise the declared text is what the router was adopted with."""

    @pytest.fixture(scope="class")
    @classmethod
    def at(cls, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stand]:
        """The coastal router as `provision` leaves it."""
        seed = "" if cls.provisioned else text().replace(_MANAGEMENT, "")
        with stand(tmp_path_factory.mktemp("stand"), version=cls.version, seed=seed) as stood:
            if cls.provisioned:
                stood.provision()
            assert stood.drift() == ""
            yield stood

    def test_reads_the_provisioned_state(self, at: Stand) -> None:
        assert shortfalls(at.ask(self.client, do="read", menus=MENUS)) == []

    def test_asks_for_some_rows_and_fields(self, at: Stand) -> None:
        told = at.ask(self.client, do="queries")
        assert (told["and"], told["len"]) == (PINGS, RULES)

    def test_writes_and_reads_every_text(self, at: Stand) -> None:
        before = at.export()
        assert tuple(at.ask(self.client, do="words", texts=TEXTS)) == TEXTS
        assert at.export() == before

    def test_is_refused_in_the_words_of_the_router(self, at: Stand) -> None:
        before = at.export()
        told = at.ask(self.client, do="refused", calls=CALLS)
        assert tuple(one[-1] if isinstance(one, list) else one for one in told) == REFUSALS
        assert at.export() == before

    def test_what_it_writes_is_drift_that_we_put_right(self, at: Stand) -> None:
        before = at.export()
        assert at.ask(self.client, do="tamper", **TAMPERED).startswith("*")
        is_put_right(at, before)
        assert shortfalls(at.ask(self.client, do="read", menus=MENUS)) == []
