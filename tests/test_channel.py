import asyncio

import pytest

from flightapp.channel import Reader, Topic


async def settle() -> None:
    """Let every task that can run do so."""
    for _ in range(3):
        await asyncio.sleep(0)


def test_topic_holds_the_newest_and_counts() -> None:
    topic: Topic[int] = Topic("numbers")
    assert topic.latest is None
    for number in (1, 2, 3):
        topic.publish(number)
    assert (topic.name, topic.latest, topic.count) == ("numbers", 3, 3)


def test_taps_see_every_message_in_the_order_they_were_added() -> None:
    topic: Topic[int] = Topic("numbers")
    seen: list[tuple[str, int]] = []
    topic.tap(lambda m: seen.append(("first", m)))
    topic.tap(lambda m: seen.append(("second", m)))
    topic.publish(1)
    topic.publish(2)
    assert seen == [("first", 1), ("second", 1), ("first", 2), ("second", 2)]


async def test_next_is_the_message_after_the_call() -> None:
    topic: Topic[int] = Topic("numbers")
    topic.publish(1)
    waiting = asyncio.create_task(topic.next())
    await settle()
    assert not waiting.done()
    topic.publish(2)
    topic.publish(3)
    assert await waiting == 2


async def test_all_waiters_are_woken() -> None:
    topic: Topic[str] = Topic("words")
    waiting = [asyncio.create_task(topic.next()) for _ in range(3)]
    await settle()
    topic.publish("go")
    assert await asyncio.gather(*waiting) == ["go"] * 3


async def test_slow_reader_skips_to_the_newest_and_takes_it_once() -> None:
    topic: Topic[int] = Topic("numbers")
    reader = Reader(topic)
    for number in (1, 2, 3):
        topic.publish(number)
    assert await reader.newest() == 3
    with pytest.raises(TimeoutError):
        await asyncio.wait_for(reader.newest(), 0.01)


async def test_reader_starts_with_what_comes_after_it() -> None:
    topic: Topic[int] = Topic("numbers")
    topic.publish(1)
    waiting = asyncio.create_task(Reader(topic).newest())
    await settle()
    assert not waiting.done()
    topic.publish(2)
    assert await waiting == 2


async def test_waiting_reader_misses_nothing_that_is_published_before_it_wakes() -> None:
    topic: Topic[int] = Topic("numbers")
    waiting = asyncio.create_task(Reader(topic).newest())
    await settle()
    topic.publish(1)
    topic.publish(2)
    assert await waiting == 2


async def test_readers_are_independent() -> None:
    topic: Topic[int] = Topic("numbers")
    quick, slow = Reader(topic), Reader(topic)
    topic.publish(1)
    assert await quick.newest() == 1
    topic.publish(2)
    assert await quick.newest() == 2
    assert await slow.newest() == 2


async def test_a_cancelled_waiter_harms_nobody() -> None:
    topic: Topic[int] = Topic("numbers")
    cancelled, waiting = asyncio.create_task(topic.next()), asyncio.create_task(topic.next())
    await settle()
    cancelled.cancel()
    await settle()
    assert cancelled.cancelled()
    topic.publish(7)
    assert await waiting == 7


async def test_giving_up_again_and_again_on_a_silent_topic_leaves_nothing_behind() -> None:
    topic: Topic[int] = Topic("silence")
    for _ in range(5):
        waiting = asyncio.create_task(topic.next())
        await settle()
        waiting.cancel()
        await settle()
    assert topic._waiters == []
