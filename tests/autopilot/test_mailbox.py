import asyncio
import threading
import time

import pytest

from flightapp.autopilot.mailbox import Mailbox


async def test_only_the_newest_is_delivered_after_a_stall():
    got = []
    mailbox = Mailbox(lambda stamp, content: got.append(content))
    thread = threading.Thread(target=lambda: [mailbox.put(k) for k in range(1000)])
    thread.start()
    thread.join()  # the loop is stalled here, as by a computation
    await asyncio.sleep(0.01)
    assert got == [999]
    assert mailbox.missed == 999


async def test_a_deeper_box_keeps_order():
    got = []
    mailbox = Mailbox(lambda stamp, content: got.append(content), depth=4)
    for k in range(6):
        mailbox.put(k)
    await asyncio.sleep(0)
    await asyncio.sleep(0)
    assert got == [2, 3, 4, 5]


async def test_stamps_are_of_the_arrival():
    got = []
    mailbox = Mailbox(lambda stamp, content: got.append(stamp))
    put = asyncio.get_running_loop().time()
    mailbox.put("x")
    time.sleep(0.05)  # noqa: ASYNC251  a stalled loop
    await asyncio.sleep(0.001)
    assert got[0] == pytest.approx(put, abs=0.01)


async def test_rates():
    mailbox = Mailbox(lambda stamp, content: None)
    assert mailbox.rate() == 0.0
    for _ in range(11):
        mailbox.put("x")
        await asyncio.sleep(0.01)
    assert 50.0 < mailbox.rate() < 101.0


async def test_a_closed_loop_is_no_error_for_the_thread():
    boxes = []

    async def make():
        boxes.append(Mailbox(lambda stamp, content: None))

    await asyncio.to_thread(asyncio.run, make())
    boxes[0].put("late")
