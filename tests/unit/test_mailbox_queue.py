"""The queue of the mailbox worker."""

import threading

import pytest

from ecatd.bus.mailbox import Mailbox
from ecatd.model.errors import BusyError, EcatError


def test_a_full_queue_is_told_and_empties() -> None:
    mailbox, go = Mailbox(), threading.Event()
    waiting = [mailbox.submit(go.wait) for _ in range(64)]
    with pytest.raises(BusyError, match="busy: 64 mailbox requests are waiting already") as caught:
        mailbox.submit(go.wait)
    assert isinstance(EcatError.from_reply(caught.value.to_reply()), BusyError)
    waiting[-1].cancel()  # one that is given up makes room at once
    waiting.append(mailbox.submit(go.wait))
    go.set()
    assert all(future.cancelled() or future.result(10) for future in waiting)
    assert mailbox.submit(lambda: 7).result(10) == 7
    mailbox.close()
