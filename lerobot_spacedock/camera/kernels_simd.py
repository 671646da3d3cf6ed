"""The two innermost steps of the rasteriser, written for LLVM's vector types instead of left to its vectoriser.

Numba turns scalar loops into vector code only where it can prove that no two arrays overlap, and then with a scalar
tail, which is what most spans of a small triangle consist of. These intrinsics name the vectors, so the code has no
branch a sample. LLVM splits a vector that is wider than the machine's own; nothing is reordered or contracted, so the
result is the same on every CPU.

Samples are kept in cells of 32: 8 columns x 4 sample rows. Cell (g, b) covers sample rows 4g .. 4g+3 and columns
8b .. 8b+7; with four samples a pixel its rows are the samples of one row of pixels.
"""

from __future__ import annotations

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from lerobot_spacedock.jit import jit

CELL_COLUMNS, CELL_ROWS = 8, 4
CELL = CELL_COLUMNS * CELL_ROWS


def samples_of(width: int, height: int, samples: int) -> int:
    """Numbers in the cells of a picture."""
    return ((width + 7) >> 3) * ((height * samples + 3) >> 2) * CELL


_I32, _F32, _F64 = ir.IntType(32), ir.FloatType(), ir.DoubleType()
_I4, _I8 = ir.VectorType(_I32, 4), ir.VectorType(_I32, 8)
_F8, _D4 = ir.VectorType(_F32, 8), ir.VectorType(_F64, 4)
_FAR_COLUMN = 1 << 30


def _splat(builder, value, size: int):
    """A vector of ``size`` copies of a scalar."""
    vector = ir.VectorType(value.type, size)
    one = builder.insert_element(ir.Constant(vector, ir.Undefined), value, _I32(0))
    return builder.shuffle_vector(one, ir.Constant(vector, ir.Undefined), ir.Constant(ir.VectorType(_I32, size), None))


def _pick(builder, vector, place: int, size: int):
    """A vector of ``size`` copies of one element of a vector."""
    mask = ir.Constant(ir.VectorType(_I32, size), [place] * size)
    return builder.shuffle_vector(vector, ir.Constant(vector.type, ir.Undefined), mask)


def _reduce(builder, vector, choose):
    """Fold the four elements of a vector into one scalar."""
    e = [builder.extract_element(vector, _I32(k)) for k in range(4)]
    fold = lambda a, b: builder.select(builder.icmp_signed(choose, a, b), a, b)  # noqa: E731
    return fold(fold(e[0], e[1]), fold(e[2], e[3]))


def _ceil(builder, x):
    """Columns <4 x double>, not negative → the next whole numbers <4 x i32>, without a call of libm."""
    whole = builder.fptosi(x, _I4)
    less = builder.fcmp_ordered("<", builder.sitofp(whole, _D4), x)
    return builder.add(whole, builder.zext(less, _I4))


def _data(context, builder, array_type, value):
    return context.make_array(array_type)(context, builder, value).data


@intrinsic
def fill_cells(typing, depth, ids, first, wide, corners, slopes, plane, y_first, y_step, offsets, triangle):
    """Depth-test one triangle against four sample rows.

    Args:
        depth: float32, 1/z of each sample, cells of 32.
        ids: int32, the triangle that each sample shows.
        first: int64, place of the rows' first cell in both arrays.
        wide: float64, columns of the picture.
        corners: five float64: x and y of the upper corner, x and y of the middle one, y of the lower one, pixels.
        slopes: three float64: dx/dy of the upper-lower, upper-middle and middle-lower edges.
        plane: three float64: 1/z = plane[0] x + plane[1] y + plane[2].
        y_first, y_step: float64, the rows' y in pixels.
        offsets: four float64, where in its column each row's samples stand.
        triangle: int32, its number.
    """
    real, whole = types.float64, types.int64
    signature = types.void(depth, ids, whole, real, corners, slopes, plane, real, real, offsets, types.int32)

    def codegen(context, builder, sig, args):
        depth_p, ids_p = (_data(context, builder, sig.args[k], args[k]) for k in (0, 1))
        ax, ay, bx, by, cy = (builder.extract_value(args[4], k) for k in range(5))
        long, upper, lower = (_splat(builder, builder.extract_value(args[5], k), 4) for k in range(3))
        gx, gy, g0 = (builder.extract_value(args[6], k) for k in range(3))
        first_cell, triangle_8 = args[2], _splat(builder, args[10], 8)
        ay4, by4, bx4, ax4 = (_splat(builder, v, 4) for v in (ay, by, bx, ax))
        off = ir.Constant(_D4, ir.Undefined)
        for k in range(4):
            off = builder.insert_element(off, builder.extract_value(args[9], k), _I32(k))
        add, sub, mul = builder.fadd, builder.fsub, builder.fmul
        rows = ir.Constant(_D4, [0.0, 1.0, 2.0, 3.0])
        y = add(_splat(builder, args[7], 4), mul(rows, _splat(builder, args[8], 4)))
        down = sub(y, ay4)
        x0 = add(ax4, mul(down, long))
        above = builder.fcmp_ordered("<", y, by4)
        x1 = builder.select(above, add(ax4, mul(down, upper)), add(bx4, mul(sub(y, by4), lower)))
        swap = builder.fcmp_ordered("<", x1, x0)
        zero, wide_4 = ir.Constant(_D4, [0.0] * 4), _splat(builder, args[3], 4)
        ends = []
        for x in (builder.select(swap, x1, x0), builder.select(swap, x0, x1)):
            x = sub(x, off)
            x = builder.select(builder.fcmp_ordered(">", x, zero), x, zero)
            ends.append(_ceil(builder, builder.select(builder.fcmp_ordered("<", x, wide_4), x, wide_4)))
        used = builder.and_(builder.fcmp_ordered(">=", y, ay4), builder.fcmp_ordered("<", y, _splat(builder, cy, 4)))
        used = builder.and_(used, builder.icmp_signed("<", ends[0], ends[1]))
        low = builder.select(used, ends[0], ir.Constant(_I4, [_FAR_COLUMN] * 4))
        high = builder.select(used, ends[1], ir.Constant(_I4, [0] * 4))
        column_first = builder.ashr(_reduce(builder, low, "<"), _I32(3))
        column_end = _reduce(builder, high, ">")
        slope_y = add(mul(_splat(builder, gy, 4), y), _splat(builder, g0, 4))
        step = mul(_splat(builder, builder.fptrunc(gx, _F32), 8), ir.Constant(_F8, [float(k) for k in range(8)]))

        entry = builder.block
        loop, done = builder.append_basic_block("cells"), builder.append_basic_block("cells.done")
        begins = builder.shl(column_first, _I32(3))
        builder.cbranch(builder.icmp_signed("<", begins, column_end), loop, done)
        builder.position_at_end(loop)
        column = builder.phi(_I32)
        column.add_incoming(begins, entry)
        x_row = add(_splat(builder, builder.sitofp(column, _F64), 4), off)
        w_row = builder.fptrunc(add(mul(_splat(builder, gx, 4), x_row), slope_y), ir.VectorType(_F32, 4))
        lane = builder.add(_splat(builder, column, 8), ir.Constant(_I8, list(range(8))))
        place = builder.add(first_cell, builder.zext(builder.shl(column, _I32(2)), ir.IntType(64)))
        for k in range(4):
            here = builder.add(place, ir.IntType(64)(8 * k))
            p = builder.bitcast(builder.gep(depth_p, [here]), _I8.as_pointer())
            q = builder.bitcast(builder.gep(ids_p, [here]), _I8.as_pointer())
            old, before = builder.load(p, align=4), builder.load(q, align=4)
            inside = builder.and_(
                builder.icmp_signed(">=", lane, _pick(builder, low, k, 8)),
                builder.icmp_signed("<", lane, _pick(builder, high, k, 8)),
            )
            # The bits of floats that are not negative are ordered as their values are. A whole-number maximum cannot
            # be turned into a masked store, which some CPUs take twenty cycles over.
            w = builder.bitcast(add(_pick(builder, w_row, k, 8), step), _I8)
            w = builder.and_(w, builder.sext(inside, _I8))
            nearer = builder.icmp_signed(">", w, old)
            builder.store(builder.select(nearer, w, old), p, align=4)
            builder.store(builder.select(nearer, triangle_8, before), q, align=4)
        following = builder.add(column, _I32(8))
        column.add_incoming(following, builder.block)
        builder.cbranch(builder.icmp_signed("<", following, column_end), loop, done)
        builder.position_at_end(done)
        return context.get_dummy_value()

    return signature, codegen


def _rows(context, builder, array_type, array, place, step, vector):
    """The four rows of a cell, ``step`` numbers apart."""
    data, rows = _data(context, builder, array_type, array), []
    for k in range(4):
        here = builder.add(place, builder.mul(step, step.type(k)))
        rows.append(builder.load(builder.bitcast(builder.gep(data, [here]), vector.as_pointer()), align=4))
    return rows


@intrinsic
def pure_columns(typing, ids, place, step):
    """Which of 8 columns show one thing in all four rows: a bit for each. Step 0 looks at one row only."""
    signature = types.int32(ids, types.int64, types.int64)

    def codegen(context, builder, sig, args):
        row = _rows(context, builder, sig.args[0], *args, _I8)
        same = builder.icmp_signed("==", row[0], row[1])
        for other in row[2:]:
            same = builder.and_(same, builder.icmp_signed("==", row[0], other))
        return builder.zext(builder.bitcast(same, ir.IntType(8)), _I32)

    return signature, codegen


@intrinsic
def columns_of(typing, ids, place, step, triangle):
    """Which of 8 columns show ``triangle`` in all four rows, a bit for each."""
    signature = types.int32(ids, types.int64, types.int64, types.int32)

    def codegen(context, builder, sig, args):
        wanted = _splat(builder, args[3], 8)
        row = _rows(context, builder, sig.args[0], *args[:3], _I8)
        same = builder.icmp_signed("==", row[0], wanted)
        for other in row[1:]:
            same = builder.and_(same, builder.icmp_signed("==", other, wanted))
        return builder.zext(builder.bitcast(same, ir.IntType(8)), _I32)

    return signature, codegen


@intrinsic
def _smallest(typing, depth, place):
    """The smallest of the 32 numbers of the cell at ``place``: nothing farther can be seen in it."""
    signature = types.float32(depth, types.int64)

    def codegen(context, builder, sig, args):
        row = _rows(context, builder, sig.args[0], *args, ir.IntType(64)(8), _F8)
        fold = lambda a, b: builder.select(builder.fcmp_ordered("<", a, b), a, b)  # noqa: E731
        low = fold(fold(row[0], row[1]), fold(row[2], row[3]))
        for half in (4, 2, 1):
            mask = ir.Constant(_I8, [(k + half) % 8 for k in range(8)])
            low = fold(low, builder.shuffle_vector(low, ir.Constant(_F8, ir.Undefined), mask))
        return builder.extract_element(low, _I32(0))

    return signature, codegen


@jit(nogil=True)
def farthest(depth, place, stride, count):
    """The smallest 1/z of ``count`` cells, ``stride`` numbers apart; stops at the first sample without anything."""
    low = np.float32(np.inf)
    for k in range(count):
        low = min(low, _smallest(depth, place + k * stride))
        if low <= np.float32(0.0):
            break
    return low
