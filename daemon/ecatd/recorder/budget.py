"""How many incidents may be written: a cause that comes again and again leaves room for others."""

from __future__ import annotations

from collections import deque

_HOUR_S = 3600.0
_PAUSE_S = 720.0
_FREE = 5
"""A fifth of the number is for whatever comes."""


class Budget:
    """The incidents of the last hour.

    The second incident of the same cause needs a pause of `720 / per_hour` seconds, a minute if
    there may be twelve; the third one of two minutes, and so on, twice as long each time. And all
    that are not the first of their cause may use half of the number only. So a cable that crackles
    all night does not keep the stop at 03:12 from being written. The first fifth of the number is
    free of this.

    Args:
        per_hour: Most incidents in an hour.
    """

    def __init__(self, per_hour: int) -> None:
        self.per_hour = per_hour
        self._written: deque[tuple[float, str]] = deque()

    def take(self, cause: str, now: float) -> str:
        """Takes an incident if there is room for it.

        Args:
            cause: What is alike in incidents of the same cause.
            now: CLOCK_MONOTONIC in seconds.

        Returns:
            Why there is no room, as a sentence; empty if it was taken.
        """
        while self._written and now - self._written[0][0] >= _HOUR_S:
            self._written.popleft()
        same = [at for at, what in self._written if what == cause]
        repeated = len(self._written) - len({what for _, what in self._written})
        if len(self._written) >= self.per_hour:
            return f"{self.per_hour} incidents were written in an hour"
        if same and len(self._written) >= self.per_hour // _FREE:
            if repeated >= self.per_hour // 2:
                return f"{repeated} incidents of an hour were of causes that had one already"
            pause = _PAUSE_S / self.per_hour * 2 ** (len(same) - 1)
            if now - same[-1] < pause:
                return f"the last incident of this cause is less than {pause:.0f} s old"
        self._written.append((now, cause))
        return ""
