"""A ring buffer."""

from __future__ import annotations

from typing import Any

import numpy as np

from skillcli.trajectories import Array


class RingBuffer:
    """Rows of several columns; when it is full, new rows replace the oldest.

    Args:
        capacity: most rows.
        dtype: of every column.
    """

    def __init__(self, capacity: int, dtype: Any = np.float64) -> None:
        self.capacity, self.filled, self.next = capacity, 0, 0
        self.columns: tuple[Array, ...] = ()  # (capacity, ...) each, once something was added
        self._dtype = dtype

    def add(self, *columns: Array) -> None:
        """Add n rows, every column (n, ...)."""
        if not self.columns:
            self.columns = tuple(np.zeros((self.capacity, *new.shape[1:]), dtype=self._dtype) for new in columns)
        count = len(columns[0])
        slots = (self.next + np.arange(count)) % self.capacity
        for kept, new in zip(self.columns, columns, strict=True):
            kept[slots] = new
        self.next = int((self.next + count) % self.capacity)
        self.filled = min(self.capacity, self.filled + count)

    def sample(self, count: int, rng: np.random.Generator) -> tuple[Array, ...]:
        """Sample `count` rows of all columns with replacement; the buffer must not be empty."""
        chosen = rng.integers(self.filled, size=count)
        return tuple(column[chosen] for column in self.columns)
