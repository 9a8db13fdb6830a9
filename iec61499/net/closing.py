"""What is closed at the end of a block."""

from __future__ import annotations

from typing import Self


class Closing:
    """A context manager that closes itself at its end."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Ends what it holds."""
        raise NotImplementedError
