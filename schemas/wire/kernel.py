"""Messages of known layout out of a chunk and into columns, compiled: each byte is looked at once.

Columns are reached by their addresses, since there are as many kinds of them as messages have fields. Whoever calls
:func:`take` vouches for the room behind each address; everything read is bounded here.
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
LATEST = 2**63 - 1
_MESSAGE, _HALF = 5, 4
_TOGETHER = 32  # messages of a lane that are moved at a time
_LINE = 64  # bytes that the processor fetches at a time
SIZE, WORDS, RECORD, MASK, WHOLE, OTHER, ROOM = range(7)
"""What is known of a lane: bytes of a record (0: any), what these must be like, where its moves begin, its room."""


@intrinsic
def word_at(typing: Any, address: Any, offset: Any) -> Any:
    """The little-endian 64-bit word at an address and so many bytes on, aligned or not."""

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        byte = builder.gep(builder.inttoptr(args[0], ir.IntType(8).as_pointer()), [args[1]])
        return builder.load(builder.bitcast(byte, ir.IntType(64).as_pointer()), align=1)

    return types.uint64(types.intp, types.intp), code


def _put(bits: int) -> Any:
    """What writes a whole number of so many bits to an address."""

    @intrinsic
    def put(typing: Any, address: Any, value: Any) -> Any:
        def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            builder.store(args[1], builder.inttoptr(args[0], ir.IntType(bits).as_pointer()), align=1)
            return context.get_dummy_value()

        return types.void(types.intp, types.Integer.from_bitwidth(bits, signed=False)), code

    return put


put_word, put_half, put_byte = _put(64), _put(32), _put(8)


@intrinsic
def expect_line(typing: Any, address: Any) -> Any:
    """Have the processor fetch the line of memory at an address, which is to be written soon."""

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        pointer, flag = ir.IntType(8).as_pointer(), ir.IntType(32)
        prefetch = cgutils.get_or_insert_function(
            builder.module, ir.FunctionType(ir.VoidType(), [pointer, flag, flag, flag]), "llvm.prefetch.p0i8"
        )
        builder.call(prefetch, [builder.inttoptr(args[0], pointer), flag(1), flag(3), flag(1)])
        return context.get_dummy_value()

    return types.void(types.intp), code


@njit(cache=True, nogil=True)
def _fits(at, words, record, mask):  # type: ignore[no-untyped-def]
    """Whether the message at an address has the bits of a record where the mask (words, both addresses) says so, and
    times of 63 bits.
    """
    off = (word_at(at, LOG_TIME) | word_at(at, PUBLISH_TIME)) >> np.uint64(63)
    for k in range(words):
        off |= (word_at(at, 8 * k) ^ word_at(record, 8 * k)) & word_at(mask, 8 * k)
    return off == 0


@njit(cache=True, nogil=True)
def take(base, start, stop, lane_of, lanes, whole, other, row, now, misfit, span, others):  # type: ignore[no-untyped-def]
    """Put the fields of every message that fits its lane into the columns, behind the first row[lane] rows.

    The records are at the addresses base + start..base + stop, with 8 bytes to spare behind them. lane_of: by channel,
    -1 for none. lanes: a row each of SIZE..; whole (m, 3): source in the record, address of the column, bytes of its
    rows, of every word to be moved as it is; other (m, 4): these and the kind of every other field. Both in order of
    the lanes, from WHOLE and OTHER of one to those of the next. Filled: now, rows there are then; misfit, lanes that a
    message does not fit, whose new rows are void; span, first and last log time; others, starts of the records that
    are not messages.

    Returns how many messages did not fit their lane or have none, how many other records there are, the lane that has
    no room left, which stops everything, and whether as many messages again might fill one. Where anything is not as it
    should be, (-1, 0, that lane or -1, False), and all new rows are void.
    """
    now[:], misfit[:], span[0], span[1] = row, False, LATEST, -1
    left = found = 0
    waiting, held = np.empty((len(row), _TOGETHER), np.int64), np.zeros_like(row)
    while start < stop:
        if stop - start < FRAME:
            return -1, 0, -1, False
        at = base + start
        opcode, length = word_at(at, 0) & np.uint64(0xFF), np.int64(word_at(at, 1))
        if opcode == 0 or length < 0 or length > stop - start - FRAME:
            return -1, 0, -1, False
        if opcode != _MESSAGE:
            if found == len(others):
                return -1, 0, -1, False
            others[found] = start
            found += 1
        elif length < BODY:
            return -1, 0, -1, False
        else:
            one = lane_of[word_at(at, CHANNEL) & np.uint64(0xFFFF)]
            if one < 0 or misfit[one]:
                left += 1
            else:
                lane = lanes[one]
                if now[one] == lane[ROOM]:
                    return -1, 0, one, False
                if lane[SIZE] in (0, FRAME + length) and _fits(at, lane[WORDS], lane[RECORD], lane[MASK]):
                    time = np.int64(word_at(at, LOG_TIME))
                    span[0], span[1] = min(span[0], time), max(span[1], time)
                    waiting[one, held[one]] = at
                    now[one] += 1
                    held[one] += 1
                    if held[one] == _TOGETHER:
                        _move(waiting[one], _TOGETHER, now[one], whole, other, lane, lanes[one + 1])
                        held[one] = 0
                else:
                    misfit[one] = True
                    left += 1
        start += FRAME + length
    near = False
    for one in range(len(row)):
        if not misfit[one]:
            _move(waiting[one], held[one], now[one], whole, other, lanes[one], lanes[one + 1])
            near |= 2 * now[one] - row[one] > lanes[one, ROOM]
    return left, found, -1, near


@njit(cache=True, nogil=True)
def _move(places, count, stop, whole, other, lane, after):  # type: ignore[no-untyped-def]
    """Move so many messages, whose addresses are given, into the rows before stop, one column after the other."""
    for j in range(lane[WHOLE], after[WHOLE]):
        source, stride = whole[j, 0], whole[j, 2]
        target = whole[j, 1] + (stop - count) * stride
        for k in range(count):
            put_word(target + k * stride, word_at(places[k], source))
        _expect(target + count * stride, count * stride)
    for j in range(lane[OTHER], after[OTHER]):
        source, stride = other[j, 0], other[j, 2]
        target = other[j, 1] + (stop - count) * stride
        for k in range(count):
            _move_one(places[k] + source, target + k * stride, stride, other[j, 3])
        _expect(target + count * stride, count * stride)


@njit(cache=True, nogil=True)
def _expect(address, count):  # type: ignore[no-untyped-def]
    for k in range(0, count, _LINE):
        expect_line(address + k)


@njit(cache=True, nogil=True)
def _move_one(source, target, width, kind):  # type: ignore[no-untyped-def]
    if kind == STAMP:
        word = word_at(source, 0)
        seconds = np.int64(np.int32(np.uint32(word & np.uint64(0xFFFFFFFF))))
        put_word(target, np.uint64(seconds * 1_000_000_000 + np.int64(word >> np.uint64(32))))
    elif kind == RAW and width == _HALF:
        put_half(target, np.uint32(word_at(source, 0) & np.uint64(0xFFFFFFFF)))
    else:
        for k in range(width):
            byte = np.uint8(word_at(source, k) & np.uint64(0xFF))
            put_byte(target + k, np.uint8(byte != 0) if kind == TRUTH else byte)


@njit(cache=True, nogil=True)
def left_over(base, start, stop, lane_of, misfit, rest):  # type: ignore[no-untyped-def]
    """The starts of the messages that :func:`take` left, or whose rows are void; returns how many these are."""
    left = 0
    while start < stop:
        at = base + start
        if word_at(at, 0) & np.uint64(0xFF) == _MESSAGE:
            one = lane_of[word_at(at, CHANNEL) & np.uint64(0xFFFF)]
            if one < 0 or misfit[one]:
                rest[left] = start
                left += 1
        start += FRAME + np.int64(word_at(at, 1))
    return left
