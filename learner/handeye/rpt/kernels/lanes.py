"""Eight samples, nodes or boxes at a time: the arithmetic under every search.

Vectors stand in *chunks* of eight lanes, component after component: component t of lane j of the chunk that begins at
`at` is `block[at + 8 * t + j]`. A chunk of boxes holds the lower corners and then, 8 d numbers later, the upper ones.
Numba does not turn eight lanes into vector instructions on its own, so these functions are written in LLVM's vector
types; LLVM maps them to whatever the processor has. Without the JIT (NUMBA_DISABLE_JIT=1) plain Python does the same.

The sums run over the components in order and are not re-associated, so that every path to a distance gives the same
number to the last bit, and a box is never farther than a sample in it.
"""

import sys

import numpy as np
from llvmlite import ir
from numba import config, types
from numba.core import cgutils
from numba.extending import intrinsic

LANES = 8

FARTHEST = sys.float_info.max

_DOUBLE = ir.DoubleType()
_INTEGER = ir.IntType(64)
_VECTOR = ir.VectorType(_DOUBLE, LANES)
_ZERO = ir.Constant(_VECTOR, [ir.Constant(_DOUBLE, 0.0)] * LANES)
_FARTHEST = ir.Constant(_VECTOR, [ir.Constant(_DOUBLE, FARTHEST)] * LANES)
_INTEGERS = ir.VectorType(_INTEGER, LANES)
_NUMBERS = ir.Constant(_INTEGERS, list(range(LANES)))
_NONE = ir.Constant(_INTEGER, 0)
_FIRST_PART = ir.Constant(_INTEGER, 8)  # components after which a chunk may turn out to be too far
_FIRST = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)

_FLOATS = types.Array(types.float64, 1, "C")
_NEAREST_SIGNATURE = types.int64(_FLOATS, types.int64, types.int64, types.int64, _FLOATS, _FLOATS)
_SIGNATURE = types.int64(_FLOATS, types.int64, _FLOATS, types.float64, _FLOATS)


def _broadcast(builder, number, vector=_VECTOR):
    undefined = ir.Constant(vector, ir.Undefined)
    alone = builder.insert_element(undefined, number, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(alone, undefined, _FIRST)


def _load(builder, base, index):
    return builder.load(builder.bitcast(builder.gep(base, [index]), _VECTOR.as_pointer()), align=8)


def _larger(builder, left, right):
    return builder.select(builder.fcmp_ordered(">", left, right), left, right)


def _add_squares(builder, total, offset, block, at, query, components):
    """Adds the squares of `offset(builder, block, index, d, x)` for components from, to, of d."""
    first, end, size = components
    with cgutils.for_range(builder, end, start=first, intp=_INTEGER) as loop:
        x = _broadcast(builder, builder.load(builder.gep(query, [loop.index])))
        index = builder.add(at, builder.mul(loop.index, ir.Constant(_INTEGER, LANES)))
        step = offset(builder, block, index, size, x)
        builder.store(builder.fadd(builder.load(total), builder.fmul(step, step)), total)


def _squares_code(offset):
    """Code for the squared distances to one chunk. Once none can be within `worst`, the rest is left out."""

    def generate(context, builder, signature, arguments):
        arrays = [context.make_array(signature.args[i])(context, builder, arguments[i]) for i in (0, 2, 4)]
        block, query, out = (array.data for array in arrays)
        size = builder.extract_value(arrays[1].shape, 0)
        worst = _broadcast(builder, arguments[3])
        total = cgutils.alloca_once_value(builder, _ZERO)
        builder.store(_ZERO, total)  # again: the first store stands before all loops around this code
        mask = cgutils.alloca_once(builder, _INTEGER)

        def store_mask():
            within = builder.fcmp_ordered("<=", builder.load(total), worst)
            builder.store(builder.zext(builder.bitcast(within, ir.IntType(LANES)), _INTEGER), mask)

        few = builder.icmp_signed("<=", size, _FIRST_PART)
        end = builder.select(few, size, _FIRST_PART)
        _add_squares(builder, total, offset, block, arguments[1], query, (_NONE, end, size))
        store_mask()
        some = builder.icmp_signed("!=", builder.load(mask), _NONE)
        with builder.if_then(builder.and_(builder.not_(few), some)):
            _add_squares(builder, total, offset, block, arguments[1], query, (end, size, size))
            store_mask()
        builder.store(builder.load(total), builder.bitcast(out, _VECTOR.as_pointer()), align=8)
        return builder.load(mask)

    return generate


def _point_offset(builder, block, index, _size, x):
    return builder.fsub(_load(builder, block, index), x)


def _box_offset(builder, block, index, size, x):
    upper = builder.add(index, builder.mul(size, ir.Constant(_INTEGER, LANES)))
    below = builder.fsub(_load(builder, block, index), x)
    above = builder.fsub(x, _load(builder, block, upper))
    return _larger(builder, _larger(builder, below, above), _ZERO)


@intrinsic
def _point_squares(_typing, block, at, query, worst, out):
    return _SIGNATURE, _squares_code(_point_offset)


@intrinsic
def _box_squares(_typing, block, at, query, worst, out):
    return _SIGNATURE, _squares_code(_box_offset)


def _least(builder, vector):
    """The smallest of a vector's numbers, in all its lanes."""
    for apart in (4, 2, 1):
        turned = [lane ^ apart for lane in range(LANES)]
        other = builder.shuffle_vector(vector, vector, ir.Constant(ir.VectorType(ir.IntType(32), LANES), turned))
        vector = builder.select(builder.fcmp_ordered("<", other, vector), other, vector)
    return vector


def _nearest_code(offset):
    """Code for a loop over chunks that keeps, in each of eight lanes, the nearest so far and its number."""

    def generate(context, builder, signature, arguments):
        _, start, step, count, _, _ = arguments
        arrays = [context.make_array(signature.args[i])(context, builder, arguments[i]) for i in (0, 4, 5)]
        block, query, out = (array.data for array in arrays)
        size = builder.extract_value(arrays[1].shape, 0)
        total = cgutils.alloca_once_value(builder, _ZERO)
        best = cgutils.alloca_once_value(builder, _FARTHEST)
        where = cgutils.alloca_once_value(builder, _NUMBERS)
        tied = cgutils.alloca_once_value(builder, ir.Constant(ir.VectorType(ir.IntType(1), LANES), [0] * LANES))
        chunks = builder.sdiv(builder.add(count, ir.Constant(_INTEGER, LANES - 1)), ir.Constant(_INTEGER, LANES))
        with cgutils.for_range(builder, chunks, intp=_INTEGER) as chunk:
            at = builder.add(start, builder.mul(chunk.index, step))
            builder.store(_ZERO, total)
            _add_squares(builder, total, offset, block, at, query, (_NONE, size, size))
            squares = builder.load(total)
            base = builder.mul(chunk.index, ir.Constant(_INTEGER, LANES))
            numbers = builder.add(_broadcast(builder, base, _INTEGERS), _NUMBERS)
            used = builder.icmp_signed("<", numbers, _broadcast(builder, count, _INTEGERS))
            old = builder.load(best)
            nearer = builder.and_(builder.fcmp_ordered("<", squares, old), used)
            same = builder.and_(builder.fcmp_ordered("==", squares, old), used)
            builder.store(builder.or_(builder.load(tied), same), tied)
            builder.store(builder.select(nearer, squares, old), best)
            builder.store(builder.select(nearer, numbers, builder.load(where)), where)
        squares = builder.load(best)
        least = _least(builder, squares)
        nearest = builder.fcmp_ordered("==", squares, least)
        mask = builder.zext(builder.bitcast(nearest, ir.IntType(LANES)), _INTEGER)
        lane = builder.trunc(builder.cttz(mask, ir.Constant(ir.IntType(1), 1)), ir.IntType(32))
        builder.store(builder.extract_element(least, ir.Constant(ir.IntType(32), 0)), out)
        found = builder.extract_element(builder.load(where), lane)
        several = builder.icmp_signed("!=", builder.and_(mask, builder.sub(mask, ir.Constant(_INTEGER, 1))), _NONE)
        ties = builder.bitcast(builder.load(tied), ir.IntType(LANES))
        several = builder.or_(several, builder.icmp_signed("!=", ties, ir.Constant(ir.IntType(LANES), 0)))
        return builder.select(several, builder.sub(ir.Constant(_INTEGER, -1), found), found)

    return generate


@intrinsic
def _nearest_point(_typing, block, at, step, count, query, out):
    return _NEAREST_SIGNATURE, _nearest_code(_point_offset)


@intrinsic
def _nearest_box(_typing, block, at, step, count, query, out):
    return _NEAREST_SIGNATURE, _nearest_code(_box_offset)


@intrinsic
def _prefetch(_typing, array, index):
    def generate(context, builder, signature, arguments):
        data = context.make_array(signature.args[0])(context, builder, arguments[0]).data
        at = builder.bitcast(builder.gep(data, [arguments[1]]), ir.IntType(8).as_pointer())
        kind = ir.FunctionType(ir.VoidType(), [at.type, *[ir.IntType(32)] * 3])
        function = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0")
        builder.call(function, [at, *(ir.Constant(ir.IntType(32), number) for number in (0, 3, 1))])
        return context.get_dummy_value()

    return types.void(array, index), generate


@intrinsic
def _lowest_bit(_typing, mask):
    def generate(_context, builder, _signature, arguments):
        return builder.cttz(arguments[0], ir.Constant(ir.IntType(1), 1))

    return types.int64(types.int64), generate


def _plain_lowest_bit(mask):
    return int(mask & -mask).bit_length() - 1


def _mask(squares, worst, out):
    out[:LANES] = squares
    return sum(1 << lane for lane in range(LANES) if squares[lane] <= worst)


def _plain_point_squares(block, at, query, worst, out):
    squares = np.zeros(LANES)
    for t, x in enumerate(query):
        squares = squares + (block[at + LANES * t : at + LANES * (t + 1)] - x) ** 2
    return _mask(squares, worst, out)


def _plain_box_squares(block, at, query, worst, out):
    squares = np.zeros(LANES)
    for t, x in enumerate(query):
        low = at + LANES * t
        high = low + LANES * len(query)
        below, above = block[low : low + LANES] - x, x - block[high : high + LANES]
        squares = squares + np.maximum(np.maximum(below, above), 0.0) ** 2
    return _mask(squares, worst, out)


def _plain_nearest(squares_of, block, at, step, count, query, out):
    squares = np.empty((count + LANES - 1) // LANES * LANES)
    for chunk in range(len(squares) // LANES):
        squares_of(block, at + chunk * step, query, np.inf, squares[chunk * LANES :])
    out[0] = min(squares[:count], default=FARTHEST)
    nearest = sorted(np.flatnonzero(squares[:count] == out[0]).tolist(), key=lambda lane: (lane % LANES, lane)) or [0]
    return nearest[0] if len(nearest) == 1 and count else -1 - nearest[0]


def _plain_nearest_point(*arguments):
    return _plain_nearest(_plain_point_squares, *arguments)


def _plain_nearest_box(*arguments):
    return _plain_nearest(_plain_box_squares, *arguments)


def _plain_prefetch(array, index):
    pass


if config.DISABLE_JIT:
    point_squares, box_squares, lowest_bit = _plain_point_squares, _plain_box_squares, _plain_lowest_bit
    nearest_point, nearest_box, prefetch = _plain_nearest_point, _plain_nearest_box, _plain_prefetch
else:
    point_squares, box_squares, lowest_bit = _point_squares, _box_squares, _lowest_bit
    nearest_point, nearest_box, prefetch = _nearest_point, _nearest_box, _prefetch
# point_squares and box_squares take (block, at, query, worst, out), put the squared distances from the query to the
# eight lanes of the chunk at `at` into out[:8], and return a bit mask of the lanes at most `worst` away; when there are
# none, what stands in `out` may be too small. lowest_bit(mask) is the number of the lowest bit of a mask that is not 0.
#
# nearest_point and nearest_box take (block, at, step, count, query, out): `count` lanes in chunks `step` apart. They
# put the least squared distance into out[0] and return its lane; -1 - lane when others may be as near.
#
# prefetch(array, index) has an element's cache line brought near, if there is such an element.
