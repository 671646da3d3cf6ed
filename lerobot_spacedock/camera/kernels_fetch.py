"""How the kernels read memory that is scattered: ahead of time, in pairs, and in rows that are turned on their side."""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from .kernels_simd import CELL_SAMPLES, F8, I8, I32, array_data


@intrinsic
def fetch_ahead(typing, cells, place):
    """Ask for what a cell's 32 samples show, which is soon to be read; a place past the end does no harm."""
    signature = types.void(cells, types.int64)

    def codegen(context, builder, sig, args):
        byte_p = ir.IntType(8).as_pointer()
        hint = ir.FunctionType(ir.VoidType(), [byte_p, I32, I32, I32])
        fetch = builder.module.declare_intrinsic("llvm.prefetch", [byte_p], hint)
        data = array_data(context, builder, sig.args[0], args[0])
        for line in (CELL_SAMPLES, CELL_SAMPLES + 16):
            here = builder.gep(data, [builder.add(args[1], ir.IntType(64)(line))])
            builder.call(fetch, [builder.bitcast(here, byte_p), I32(0), I32(3), I32(1)])
        return context.get_dummy_value()

    return signature, codegen


_UNPACK = ([0, 8, 1, 9, 4, 12, 5, 13], [2, 10, 3, 11, 6, 14, 7, 15])  # of two rows: the shuffles that AVX has
_PAIRS = ([0, 1, 8, 9, 4, 5, 12, 13], [2, 3, 10, 11, 6, 7, 14, 15])
_HALVES = ([0, 1, 2, 3, 8, 9, 10, 11], [4, 5, 6, 7, 12, 13, 14, 15])


@intrinsic
def turn_rows(typing, table, size, which, place, column, out, to, stride):
    """Eight numbers of each of eight rows of a table, turned on their side.

    Args:
        table: float32, C-ordered, rows of ``size`` numbers.
        which: int32; its elements ``place`` .. ``place + 7`` are the rows.
        column: the first number of each row.
        out: float32, flat; number ``c`` of the ``k``-th row goes to ``to + c * stride + k``.
    """
    whole = types.int64
    signature = types.void(table, whole, which, whole, whole, out, whole, whole)

    def codegen(context, builder, sig, args):
        table_p, which_p, out_p = (array_data(context, builder, sig.args[k], args[k]) for k in (0, 2, 5))
        place, column = args[3], args[4]
        i64 = ir.IntType(64)
        rows = []
        for k in range(8):
            row = builder.zext(builder.load(builder.gep(which_p, [builder.add(place, i64(k))])), i64)
            here = builder.gep(table_p, [builder.add(builder.mul(row, args[1]), column)])
            rows.append(builder.load(builder.bitcast(here, F8.as_pointer()), align=4))
        mix = lambda a, b, mask: builder.shuffle_vector(a, b, ir.Constant(I8, mask))  # noqa: E731
        pairs = [[mix(rows[k], rows[k + 1], mask) for mask in _UNPACK] for k in (0, 2, 4, 6)]
        fours = [[mix(a[h], b[h], mask) for h in (0, 1) for mask in _PAIRS] for a, b in (pairs[:2], pairs[2:])]
        turned = [mix(fours[0][c], fours[1][c], mask) for mask in _HALVES for c in range(4)]
        for c, vector in enumerate(turned):
            here = builder.gep(out_p, [builder.add(args[6], builder.mul(args[7], i64(c)))])
            builder.store(vector, builder.bitcast(here, F8.as_pointer()), align=4)
        return context.get_dummy_value()

    return signature, codegen


@intrinsic
def load_pair(typing, array, place, kind):
    """Two neighbours of an array, read at once as one whole number of ``kind``, the first in its lower half."""
    signature = kind.dtype(array, types.uint64, kind)

    def codegen(context, builder, sig, args):
        pair = ir.IntType(sig.return_type.bitwidth)
        data = array_data(context, builder, sig.args[0], args[0])
        here = builder.bitcast(builder.gep(data, [args[1]]), pair.as_pointer())
        return builder.load(here, align=sig.args[0].dtype.bitwidth // 8)

    return signature, codegen
