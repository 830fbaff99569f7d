"""Messages of known layout out of a chunk and into columns, compiled: each byte is looked at once.

Columns are reached by their addresses, since there are as many kinds of them as messages have fields. Whoever calls
:func:`move` vouches for the room behind each address; everything read is bounded here.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic

FRAME, BODY = 9, 22  # bytes of a record's frame and of a message before its payload
CHANNEL, LOG_TIME, PUBLISH_TIME = 9, 15, 23  # where they stand in a message record
RAW, STAMP, TRUTH = 0, 1, 2  # kinds of move
_MESSAGE = 5


@intrinsic
def word_at(typing: Any, address: Any) -> Any:
    """The little-endian 64-bit word at an address, aligned or not."""

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        pointer = builder.inttoptr(args[0], ir.IntType(64).as_pointer())
        return builder.load(pointer, align=1)

    return types.uint64(types.intp), code


@intrinsic
def put_word(typing: Any, address: Any, value: Any) -> Any:
    """Write a 64-bit word to an address."""

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        pointer = builder.inttoptr(args[0], ir.IntType(64).as_pointer())
        builder.store(args[1], pointer, align=1)
        return context.get_dummy_value()

    return types.void(types.intp, types.uint64), code


@intrinsic
def put_byte(typing: Any, address: Any, value: Any) -> Any:
    """Write one byte to an address."""

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        builder.store(args[1], builder.inttoptr(args[0], ir.IntType(8).as_pointer()))
        return context.get_dummy_value()

    return types.void(types.intp, types.uint8), code


@intrinsic
def differ(typing: Any, one: Any, other: Any, count: Any) -> Any:
    """Zero where count bytes at one address are those at another."""

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        pointer, size = ir.IntType(8).as_pointer(), ir.IntType(64)
        kind = ir.FunctionType(ir.IntType(32), [pointer, pointer, size])
        compare = cgutils.get_or_insert_function(builder.module, kind, "memcmp")
        return builder.call(compare, [builder.inttoptr(args[0], pointer), builder.inttoptr(args[1], pointer), args[2]])

    return types.int32(types.intp, types.intp, types.intp), code


@njit(cache=True, nogil=True)
def _fits(at, first, stop, fixed):  # type: ignore[no-untyped-def]
    """Whether the record at an address has the bytes that fixed[first:stop] name, and times of 63 bits."""
    if (word_at(at + LOG_TIME) | word_at(at + PUBLISH_TIME)) >> np.uint64(63):
        return False
    for k in range(first, stop):  # noqa: SIM110
        if differ(at + fixed[k, 0], fixed[k, 1], fixed[k, 2]):
            return False
    return True


@njit(cache=True, nogil=True)
def scan(buffer, base, start, stop, plan_of, size, first, fixed, misfit, count, place, plan, others):  # type: ignore[no-untyped-def]
    """Find the records in buffer[start:stop]; base: address of buffer, which goes on for 8 bytes after stop.

    size: bytes of a record of each plan (0: any); first: where each begins in fixed (f, 3): byte in the record,
    address of what must be there, how many bytes. count: messages of each plan, added up.
    place, plan: start and plan (-1: none) of each message; others: starts of other records; misfit: set for plans
    that a message does not fit. Returns how many of both; (-1, 0) where anything is not as it should be.
    """
    n = m = 0
    while start < stop:
        if stop - start < FRAME:
            return -1, 0
        opcode = buffer[start]
        length = np.int64(word_at(base + start + 1))
        if opcode == 0 or length < 0 or length > stop - start - FRAME:
            return -1, 0
        if opcode == _MESSAGE:
            if length < BODY:
                return -1, 0
            one = plan_of[np.int64(buffer[start + CHANNEL]) | np.int64(buffer[start + CHANNEL + 1]) << 8]
            if one >= 0:
                same = size[one] in (0, FRAME + length)
                misfit[one] |= not (same and _fits(base + start, first[one], first[one + 1], fixed))
                count[one] += 1
            place[n], plan[n] = start, one
            n += 1
        else:
            if m == len(others):
                return -1, 0
            others[m] = start
            m += 1
        start += FRAME + length
    return n, m


@njit(cache=True, nogil=True)
def move(base, place, plan, misfit, row, span, first, kind, source, width, address, rest):  # type: ignore[no-untyped-def]
    """Put the fields of every message whose plan fits into the columns, from row[plan] on; row is advanced.

    first: where the moves of each plan begin. span: first and last log time, widened. rest: starts of the messages that
    were not taken; returns how many these are.
    """
    left = 0
    for k in range(len(place)):
        one = plan[k]
        if one < 0 or misfit[one]:
            rest[left] = place[k]
            left += 1
            continue
        at = base + place[k]
        time = np.int64(word_at(at + LOG_TIME))
        span[0], span[1] = min(span[0], time), max(span[1], time)
        for j in range(first[one], first[one + 1]):
            _move_one(kind[j], at + source[j], address[j] + row[one] * width[j], width[j])
        row[one] += 1
    return left


@njit(cache=True, nogil=True)
def _move_one(kind, source, target, width):  # type: ignore[no-untyped-def]
    if kind == STAMP:
        word = word_at(source)
        seconds = np.int64(np.int32(np.uint32(word & np.uint64(0xFFFFFFFF))))
        put_word(target, np.uint64(seconds * 1_000_000_000 + np.int64(word >> np.uint64(32))))
    elif kind == TRUTH:
        for k in range(width):
            put_byte(target + k, np.uint8(_byte(source + k) != 0))
    else:
        whole = width & ~7
        for k in range(0, whole, 8):
            put_word(target + k, word_at(source + k))
        for k in range(whole, width):
            put_byte(target + k, _byte(source + k))


@njit(cache=True, nogil=True)
def _byte(address):  # type: ignore[no-untyped-def]
    return np.uint8(word_at(address) & np.uint64(0xFF))
