"""Waiting for a condition. The limit is generous: it ends a test that has failed anyway."""
import os
import time

LIMIT = float(os.environ.get("PLCLINK_TEST_LIMIT", 60))  # s


def until(condition, what="the condition", limit=LIMIT):
    """Returns the first true value of condition(); AssertionError after `limit` seconds."""
    deadline = time.monotonic() + limit
    while True:
        value = condition()
        if value:
            return value
        if time.monotonic() > deadline:
            detail = what() if callable(what) else what
            raise AssertionError(f"not within {limit:g} s: {detail}")
        time.sleep(0.01)  # the pace of the looks


def until_equal(read, wanted, limit=LIMIT):
    """Waits until read() returns `wanted`; the message shows the last value."""
    last = []

    def check():
        last[:] = [read()]
        return last[0] == wanted
    until(check, lambda: f"{last[0]!r} should become {wanted!r}", limit)
    return last[0]
