"""Clients that take no answers hold up nobody."""

import threading
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import zenoh

from ecatd.gateway.replies import Replies
from ecatd.gateway.sessions import Sessions
from ecatd.operations.zenoh_keys import session_config

PATIENCE = 60.0


def test_a_client_that_takes_nothing_holds_up_nobody() -> None:
    """Sending blocks, as Zenoh does, and another reply is sent nevertheless."""
    replies, taken, sent = Replies(64, are_here=True), threading.Event(), threading.Event()
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
    replies, taken = Replies(64, are_here=True), threading.Event()
    begun: list[int] = []
    all_begun = threading.Event()

    def wait() -> None:
        taken.wait(PATIENCE)

    def begin(number: int) -> None:
        begun.append(number)
        replies.send(wait)
        if len(begun) == 1000:
            all_begun.set()

    for number in range(1000):  # nobody waits here, since Zenoh receives for all in this thread
        replies.take(partial(begin, number), 1000)
    time.sleep(0.5)
    assert 1 <= len(begun) <= 100, "queries wait for a place"
    taken.set()
    assert all_begun.wait(PATIENCE)
    assert begun == [*range(1000)]


def test_a_program_of_this_machine_that_is_stopped_holds_up_no_other(tmp_path: Path) -> None:
    """Zenoh waits while it sends a reply, and another one is sent nevertheless."""
    endpoint = f"unixsock-stream/{tmp_path}/z"
    taken = threading.Event()

    def receive(query: zenoh.Query, replies: Replies) -> None:
        def reply() -> None:
            with query:
                if str(query.key_expr) == "a/stopped":
                    taken.wait(PATIENCE)
                query.reply(query.key_expr, b"answer")

        replies.send(reply)

    sessions = Sessions([zenoh.open(session_config("peer", {"listen/endpoints": [endpoint]}))])
    try:
        sessions.serve("a/**", receive)
        client = session_config("client", {"connect/endpoints": [endpoint]})
        with zenoh.open(client) as one, zenoh.open(client) as other:
            waits = one.get("a/stopped", timeout=PATIENCE)
            assert [reply.ok.payload.to_bytes() for reply in other.get("a/b")] == [b"answer"]
            taken.set()
            assert [reply.ok.payload.to_bytes() for reply in waits] == [b"answer"]
    finally:
        taken.set()
        sessions.close()


def send(replies: Replies, reply: Callable[[], None]) -> None:
    replies.take(lambda: replies.send(reply), 0)
