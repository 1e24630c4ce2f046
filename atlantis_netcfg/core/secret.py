"""Secret values that cannot be printed by accident."""

from __future__ import annotations

MASK = "********"
EXAMPLE_PREFIX = "EXAMPLE-"


class Secret:
    """A value whose text form is masked; `reveal()` is the only way out, so it can be found by searching."""

    __slots__ = ("_value",)

    def __init__(self, value: str) -> None:
        self._value = value

    def reveal(self) -> str:
        """The value itself: for the wire and for 0600 files, nowhere else."""
        return self._value

    @property
    def is_example(self) -> bool:
        """True for values that ship with the inventory and must be replaced before a real run."""
        return self._value.startswith(EXAMPLE_PREFIX)

    def __repr__(self) -> str:
        return f"Secret({MASK!r})"

    def __str__(self) -> str:
        return MASK

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Secret):
            return NotImplemented
        import hmac  # noqa: PLC0415 - OpenSSL comes with it, of which help and validation have no need

        return hmac.compare_digest(self._value.encode(), other._value.encode())

    def __hash__(self) -> int:
        return hash(self._value)
