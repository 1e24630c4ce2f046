"""What is changed in an image: value objects, made by a planner that touches nothing, and carried out elsewhere."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Directory", "Edit", "File", "Link", "Remove"]


@dataclass(frozen=True, slots=True)
class File:
    """Write a regular file; one that is there is replaced."""

    path: str
    content: bytes
    mode: int = 0o644
    owner: tuple[int, int] = (0, 0)
    """User and group by number."""


@dataclass(frozen=True, slots=True)
class Directory:
    """Make a directory where there is none, or correct its mode and owner."""

    path: str
    mode: int = 0o755
    owner: tuple[int, int] = (0, 0)


@dataclass(frozen=True, slots=True)
class Link:
    """A symbolic link; a file or link that is there is replaced."""

    path: str
    target: str


@dataclass(frozen=True, slots=True)
class Remove:
    """Remove a file or link."""

    path: str


Edit = File | Directory | Link | Remove
