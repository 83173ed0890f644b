"""Outputs that the user of the screen holds by hand: a thread renews them."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from ecatd.base.errors import EcatError, LeaseError
from ecatd.client.hold import Hold

if TYPE_CHECKING:
    from ecatd.client.remote import Remote

_NOTHING: Mapping[str, str] = {}


class ByHand:
    """Holds outputs until they are released, or the screen ends.

    Args:
        open_session: Opens a session.
        tell: Gets in a thread what is held from now on, by name, and a sentence about it.
    """

    def __init__(
        self, open_session: Callable[[], Remote], tell: Callable[[Mapping[str, str], str], object]
    ) -> None:
        self._open_session = open_session
        self._tell = tell
        self._wishes: queue.SimpleQueue[Mapping[str, str]] = queue.SimpleQueue()
        self._thread: threading.Thread | None = None
        self._lock = threading.Lock()

    def want(self, values: Mapping[str, str]) -> None:
        """Has outputs held.

        Args:
            values: All that are held from now on, with the value that the user has typed; empty to
                release all.
        """
        with self._lock:
            if self._thread is None and not values:
                return
            self._wishes.put(values)
            if self._thread is None:
                self._thread = threading.Thread(target=self._work, daemon=True)
                self._thread.start()

    def close(self) -> None:
        """Releases all, and waits for it."""
        thread = self._thread
        self.want(_NOTHING)
        if thread is not None:
            thread.join()

    def _work(self) -> None:
        said = "Released: the outputs have their safe values."
        try:
            with self._open_session() as remote:
                said = self._hold(remote) or said
        except EcatError as error:
            said = str(error)
        with self._lock:
            self._thread = None
            self._wishes = queue.SimpleQueue()
        self._tell(_NOTHING, said)

    def _hold(self, remote: Remote) -> str:
        """Works until nothing is held any more; returns why, if the user did not want this."""
        held = self._wishes.get()
        if not held:
            return ""
        with Hold(remote, held) as hold:
            self._tell(held, "")
            while held:
                try:
                    wanted = self._wishes.get_nowait()
                except queue.Empty:
                    hold.renew()
                    continue
                if not wanted:
                    break
                changed = {
                    name: None if held.get(name) == value else value
                    for name, value in wanted.items()
                }
                try:
                    hold.change(changed)
                except LeaseError:
                    raise
                except EcatError as error:
                    self._tell(held, str(error))
                else:
                    held = wanted
                    self._tell(held, "")
        return ""
