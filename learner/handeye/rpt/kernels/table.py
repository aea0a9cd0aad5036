"""Arrays by address: one argument in place of seven.

Entering a compiled function costs some 60 ns for each array argument, much in a call of 1.5 µs. A table names arrays
once, by address and shape; whoever makes one keeps the arrays alive as long as it (`Table`).
"""

import ctypes
from typing import Any

import numpy as np
from llvmlite import ir
from numba import carray, config, njit, types
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.typing import NDArray

STACK = 2048
"""So many numbers are had from the stack without asking for memory: 16 KiB."""


@intrinsic
def _pointer(_typing, address):
    def generate(_context, builder, _signature, arguments):
        return builder.inttoptr(arguments[0], cgutils.voidptr_t)

    return types.voidptr(types.int64), generate


@njit(cache=True, nogil=True)
def _floats_at(table, entry):
    return carray(_pointer(table[3 * entry]), (table[3 * entry + 1] * table[3 * entry + 2],), dtype=np.float64)


@njit(cache=True, nogil=True)
def _integers_at(table, entry):
    return carray(_pointer(table[3 * entry]), (table[3 * entry + 1] * table[3 * entry + 2],), dtype=np.int64)


@njit(cache=True, nogil=True)
def _matrix_at(table, entry):
    return carray(_pointer(table[3 * entry]), (table[3 * entry + 1], table[3 * entry + 2]), dtype=np.float64)


@intrinsic
def _stack_address(_typing):
    def generate(_context, builder, _signature, _arguments):
        return builder.ptrtoint(cgutils.alloca_once(builder, ir.DoubleType(), STACK), ir.IntType(64))

    return types.int64(), generate


def _plain(kind, dtype):
    def array_at(table, entry):
        address, rows, columns = (int(number) for number in table[3 * entry : 3 * entry + 3])
        return np.frombuffer((kind * (rows * columns)).from_address(address), dtype)

    return array_at


def _plain_matrix(table, entry):
    return _plain(ctypes.c_double, np.float64)(table, entry).reshape(table[3 * entry + 1], table[3 * entry + 2])


@njit(cache=True, nogil=True, inline="always")
def _scratch():
    return carray(_pointer(_stack_address()), (STACK,), dtype=np.float64)


if config.DISABLE_JIT:
    floats_at, integers_at = _plain(ctypes.c_double, np.float64), _plain(ctypes.c_int64, np.int64)
    matrix_at = _plain_matrix

    def scratch():
        """Scratch."""
        return np.empty(STACK)

else:
    scratch = _scratch
    floats_at, integers_at, matrix_at = _floats_at, _integers_at, _matrix_at


class Table:
    """Contiguous float64 or int64 arrays of one or two dimensions, by number, and the table that kernels read."""

    __slots__ = ("arrays", "numbers")

    def __init__(self, *arrays: NDArray[Any]) -> None:
        self.arrays = arrays
        entries = []
        for array in arrays:
            if not array.flags.c_contiguous or array.dtype.char not in "dl":
                raise ValueError(f"a table takes contiguous float64 and int64 arrays, not {array.dtype}")
            rows, columns = array.shape if array.ndim == 2 else (len(array), 1)
            entries += [array.__array_interface__["data"][0], rows, columns]
        self.numbers = np.array(entries, np.int64)
