"""Secret values that cannot be printed by accident."""

from __future__ import annotations

MASK = "********"
EXAMPLE_PREFIX = "EXAMPLE-"


class Secret:
    """A value with masked text form; `reveal()` is the only access, so that all uses can be found by search."""

    __slots__ = ("_value",)

    def __init__(self, value: str) -> None:
        self._value = value

    def reveal(self) -> str:
        """Return the plain value, only for sending and for files with mode 0600."""
        return self._value

    @property
    def is_example(self) -> bool:
        """Whether the value is an example of the inventory that must be replaced before a real run."""
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
