"""Changes that arrive twice, and how long the bus server remembers them."""

import asyncio
from typing import Any

import pytest

from ecatd.base.errors import StateError
from ecatd.server.control import KEPT, AnsweredChanges


class Changes:
    """Counts how often each change was carried out."""

    def __init__(self) -> None:
        self.answered = AnsweredChanges()
        self.done: list[str] = []
        self.go_on = asyncio.Event()
        self.go_on.set()

    async def ask(self, user: str, identity: str) -> dict[str, Any]:
        return await self.answered.answer(
            user, identity, lambda: self._carry_out(f"{user} {identity}")
        )

    async def _carry_out(self, name: str) -> dict[str, Any]:
        self.done.append(name)
        await self.go_on.wait()
        if "wrong" in name:
            raise StateError(f"{name} is wrong")
        return {"number": len(self.done)}


def test_r38_a_change_that_comes_again_has_the_same_answer() -> None:
    async def run() -> None:
        changes = Changes()
        assert await changes.ask("anna", "1") == {"number": 1}
        assert await changes.ask("bob", "1") == {"number": 2}  # another user's
        assert await changes.ask("anna", "1") == {"number": 1}
        for _ in range(2):
            with pytest.raises(StateError, match="anna wrong"):
                await changes.ask("anna", "wrong")
        assert changes.done == ["anna 1", "bob 1", "anna wrong"]

    asyncio.run(run())


def test_r38_whoever_asked_first_has_gone_before_the_answer() -> None:
    async def run() -> None:
        changes = Changes()
        changes.go_on.clear()
        gone = asyncio.create_task(changes.ask("anna", "1"))
        await asyncio.sleep(0)
        await asyncio.sleep(0)
        gone.cancel()
        again = asyncio.create_task(changes.ask("anna", "1"))
        await asyncio.sleep(0)
        changes.go_on.set()
        assert await again == {"number": 1}
        assert changes.done == ["anna 1"]
        assert gone.cancelled()

    asyncio.run(run())


def test_only_the_oldest_answers_of_the_same_user_are_forgotten() -> None:
    async def run() -> None:
        changes = Changes()
        await changes.ask("anna", "first")
        changes.go_on.clear()
        waiting = asyncio.create_task(changes.ask("bob", "slow"))
        await asyncio.sleep(0)
        await asyncio.sleep(0)
        changes.go_on.set()
        for number in range(KEPT + 1):
            await changes.ask("bob", str(number))
        await waiting
        before = len(changes.done)
        await changes.ask("anna", "first")
        await changes.ask("bob", str(KEPT))
        assert len(changes.done) == before
        await changes.ask("bob", "0")
        assert len(changes.done) == before + 1

    asyncio.run(run())


def test_what_is_still_to_come_is_not_forgotten() -> None:
    async def run() -> None:
        changes = Changes()
        changes.go_on.clear()
        many = [asyncio.create_task(changes.ask("bob", str(n))) for n in range(2 * KEPT)]
        again = asyncio.create_task(changes.ask("bob", "0"))
        await asyncio.sleep(0)
        changes.go_on.set()
        assert (await asyncio.gather(*many))[0] == await again
        assert len(changes.done) == 2 * KEPT

    asyncio.run(run())
