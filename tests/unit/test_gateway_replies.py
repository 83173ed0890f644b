"""Clients of the network that take no answers hold up neither each other nor this machine."""

import threading
from collections.abc import Callable

from ecatd.gateway.replies import Replies

PATIENCE = 60.0


def test_a_client_that_takes_nothing_holds_up_nobody() -> None:
    """Sending blocks, as Zenoh does, and another reply is sent nevertheless."""
    replies, taken, sent = Replies(), threading.Event(), threading.Event()
    begun = threading.Semaphore(0)

    def blocked() -> None:
        begun.release()
        taken.wait(PATIENCE)

    for _ in range(3):
        send(replies, blocked)
        assert begun.acquire(timeout=PATIENCE)
    send(replies, sent.set)
    assert sent.wait(PATIENCE)
    taken.set()


def test_queries_are_limited_and_their_places_come_back() -> None:
    replies, taken = Replies(), threading.Event()
    entered: list[int] = []

    def wait() -> None:
        taken.wait(PATIENCE)

    def ask() -> None:
        for number in range(1000):
            send(replies, wait)
            entered.append(number)

    asking = threading.Thread(target=ask, daemon=True)
    asking.start()
    asking.join(0.5)
    assert 1 <= len(entered) <= 100, "queries wait for a place"
    taken.set()
    asking.join(PATIENCE)
    assert len(entered) == 1000


def send(replies: Replies, reply: Callable[[], None]) -> None:
    replies.enter()
    replies.send(reply)
