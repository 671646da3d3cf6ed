"""The two innermost steps of the rasteriser, written for LLVM's vector types instead of left to its vectoriser.

Numba turns scalar loops into vector code only where it can prove that no two arrays overlap, and then with a scalar
tail, which is what most spans of a small triangle consist of. These intrinsics name the vectors, so the code has no
branch a sample. LLVM splits a vector that is wider than the machine's own; nothing is reordered or contracted, so the
result is the same on every CPU.

Samples are kept in cells of 32: 8 columns x 4 sample rows. Cell (g, b) covers sample rows 4g .. 4g+3 and columns
8b .. 8b+7; with four samples a pixel its rows are the samples of one row of pixels. A cell is 64 whole numbers: the
bits of the samples' 1/z, then what they show. Eight cells that stand one above the other are a tile, which is one piece
of memory, because most triangles are small and reach down as far as across.
"""

from __future__ import annotations

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from lerobot_spacedock.jit import inner

CELL_COLUMNS, CELL_ROWS = 8, 4
CELL_SAMPLES = CELL_COLUMNS * CELL_ROWS
CELL = 2 * CELL_SAMPLES
TILE_CELLS = 8


def tiles_of(width: int, height: int, samples: int) -> int:
    """Tiles of a picture."""
    groups = (height * samples + 3) >> 2
    return ((width + 7) >> 3) * ((groups + TILE_CELLS - 1) // TILE_CELLS)


@inner(forceinline=True)
def cell_place(group, block, blocks):
    """Where the cell of four sample rows ``group`` and eight columns ``block`` begins."""
    return (((group >> 3) * blocks + block) * TILE_CELLS + (group & 7)) * CELL


I32, _F32, _F64 = ir.IntType(32), ir.FloatType(), ir.DoubleType()
_I4, I8 = ir.VectorType(I32, 4), ir.VectorType(I32, 8)
F8, _D4 = ir.VectorType(_F32, 8), ir.VectorType(_F64, 4)
_FAR_COLUMN = 1 << 30


def _splat(builder, value, size: int):
    """A vector of ``size`` copies of a scalar."""
    vector = ir.VectorType(value.type, size)
    one = builder.insert_element(ir.Constant(vector, ir.Undefined), value, I32(0))
    return builder.shuffle_vector(one, ir.Constant(vector, ir.Undefined), ir.Constant(ir.VectorType(I32, size), None))


def _pick(builder, vector, place: int, size: int):
    """A vector of ``size`` copies of one element of a vector."""
    mask = ir.Constant(ir.VectorType(I32, size), [place] * size)
    return builder.shuffle_vector(vector, ir.Constant(vector.type, ir.Undefined), mask)


def _reduce(builder, vector, choose):
    """Fold the four elements of a vector into one scalar."""
    for half in (2, 1):
        mask = ir.Constant(_I4, [(k + half) % 4 for k in range(4)])
        other = builder.shuffle_vector(vector, ir.Constant(_I4, ir.Undefined), mask)
        vector = builder.select(builder.icmp_signed(choose, vector, other), vector, other)
    return builder.extract_element(vector, I32(0))


def _ceil(builder, x):
    """Columns <4 x double>, not negative → the next whole numbers <4 x i32>, without a call of libm."""
    whole = builder.fptosi(x, _I4)
    less = builder.fcmp_ordered("<", builder.sitofp(whole, _D4), x)
    return builder.add(whole, builder.zext(less, _I4))


class _VolatileStore(ir.instructions.StoreInstr):
    """A store that LLVM leaves as it is (llvmlite has no word for it)."""

    def descr(self, buf):
        super().descr(buf)
        buf[-1] = buf[-1].replace("store ", "store volatile ", 1)


def _store_all(builder, vector, pointer) -> None:
    """Store a choice between old and new whole. LLVM would make it a masked store, which costs AMD's CPUs 20 cycles."""
    store = _VolatileStore(builder.block, vector, pointer)
    store.align = 4
    builder._insert(store)


def array_data(context, builder, array_type, value):
    return context.make_array(array_type)(context, builder, value).data


def _clear_tile(builder, pointer, begin, end) -> None:
    """Set a tile's cells to nothing, infinitely far away."""
    loop, after = builder.append_basic_block("clear_cell"), builder.append_basic_block("cleared")
    builder.branch(loop)
    builder.position_at_end(loop)
    cell = builder.phi(ir.IntType(64))
    cell.add_incoming(ir.IntType(64)(0), begin)
    for value, first in ((0, 0), (-1, CELL_SAMPLES)):
        for k in range(0, CELL_SAMPLES, 8):
            here = builder.add(builder.mul(cell, ir.IntType(64)(CELL)), ir.IntType(64)(first + k))
            vector = ir.Constant(I8, [value] * 8)
            builder.store(vector, builder.bitcast(builder.gep(pointer, [here]), I8.as_pointer()), align=4)
    following = builder.add(cell, ir.IntType(64)(1))
    cell.add_incoming(following, builder.block)
    builder.cbranch(builder.icmp_signed("<", following, ir.IntType(64)(TILE_CELLS)), loop, after)
    builder.position_at_end(after)


@intrinsic
def fill_cells(
    typing, cells, floors, first, tile, wide, corners, slopes, plane, nearest, y_first, y_step, offsets, surface
):
    """Depth-test one triangle against four sample rows.

    Args:
        cells: int32, the picture's samples.
        floors: float32, the farthest 1/z of each tile; tiles with nothing farther than ``nearest`` are passed over, and
            those that nothing was drawn into (-1) are cleared first.
        first, tile: int64, places of the rows' first cell and of its tile.
        wide: float64, columns of the picture.
        corners: five float64: x and y of the upper corner, x and y of the middle one, y of the lower one, pixels.
        slopes: three float64: dx/dy of the upper-lower, upper-middle and middle-lower edges.
        plane: three float64: 1/z = plane[0] x + plane[1] y + plane[2].
        nearest: float32, the triangle's largest 1/z.
        y_first, y_step: float64, the rows' y in pixels.
        offsets: four float64, where in its column each row's samples stand.
        surface: int32, what it is part of.
    """
    real, whole = types.float64, types.int64
    rest = (corners, slopes, plane, types.float32, real, real, offsets, types.int32)
    signature = types.void(cells, floors, whole, whole, real, *rest)

    def codegen(context, builder, sig, args):
        cells_p = array_data(context, builder, sig.args[0], args[0])
        floors_p = array_data(context, builder, sig.args[1], args[1])
        first_cell, tile, wide, nearest, y_first, y_step, offset = (args[k] for k in (2, 3, 4, 8, 9, 10, 11))
        ax, ay, bx, by, cy = (builder.extract_value(args[5], k) for k in range(5))
        long, upper, lower = (_splat(builder, builder.extract_value(args[6], k), 4) for k in range(3))
        gx, gy, g0 = (builder.extract_value(args[7], k) for k in range(3))
        surface_8 = _splat(builder, args[12], 8)
        ay4, by4, bx4, ax4 = (_splat(builder, v, 4) for v in (ay, by, bx, ax))
        off = ir.Constant(_D4, ir.Undefined)
        for k in range(4):
            off = builder.insert_element(off, builder.extract_value(offset, k), I32(k))
        add, sub, mul = builder.fadd, builder.fsub, builder.fmul
        rows = ir.Constant(_D4, [0.0, 1.0, 2.0, 3.0])
        y = add(_splat(builder, y_first, 4), mul(rows, _splat(builder, y_step, 4)))
        down = sub(y, ay4)
        x0 = add(ax4, mul(down, long))
        above = builder.fcmp_ordered("<", y, by4)
        x1 = builder.select(above, add(ax4, mul(down, upper)), add(bx4, mul(sub(y, by4), lower)))
        swap = builder.fcmp_ordered("<", x1, x0)
        zero, wide_4 = ir.Constant(_D4, [0.0] * 4), _splat(builder, wide, 4)
        ends = []
        for x in (builder.select(swap, x1, x0), builder.select(swap, x0, x1)):
            x = sub(x, off)
            x = builder.select(builder.fcmp_ordered(">", x, zero), x, zero)
            ends.append(_ceil(builder, builder.select(builder.fcmp_ordered("<", x, wide_4), x, wide_4)))
        used = builder.and_(builder.fcmp_ordered(">=", y, ay4), builder.fcmp_ordered("<", y, _splat(builder, cy, 4)))
        used = builder.and_(used, builder.icmp_signed("<", ends[0], ends[1]))
        low = builder.select(used, ends[0], ir.Constant(_I4, [_FAR_COLUMN] * 4))
        high = builder.select(used, ends[1], ir.Constant(_I4, [0] * 4))
        column_first = builder.ashr(_reduce(builder, low, "<"), I32(3))
        column_end = _reduce(builder, high, ">")
        slope_y = add(mul(_splat(builder, gy, 4), y), _splat(builder, g0, 4))
        step = mul(_splat(builder, builder.fptrunc(gx, _F32), 8), ir.Constant(F8, [float(k) for k in range(8)]))

        entry = builder.block
        names = ("cells", "fresh", "clear", "draw", "onward", "done")
        loop, fresh, clear, draw, onward, done = map(builder.append_basic_block, names)
        begins = builder.shl(column_first, I32(3))
        builder.cbranch(builder.icmp_signed("<", begins, column_end), loop, done)
        builder.position_at_end(loop)
        column = builder.phi(I32)
        column.add_incoming(begins, entry)
        this = builder.add(tile, builder.zext(builder.ashr(column, I32(3)), ir.IntType(64)))
        floor = builder.load(builder.gep(floors_p, [this]))
        builder.cbranch(builder.fcmp_ordered("<", floor, nearest), fresh, onward)
        builder.position_at_end(fresh)
        builder.cbranch(builder.fcmp_ordered("<", floor, _F32(0.0)), clear, draw)
        builder.position_at_end(clear)
        tile_p = builder.gep(cells_p, [builder.mul(this, ir.IntType(64)(TILE_CELLS * CELL))])
        _clear_tile(builder, tile_p, clear, draw)
        builder.store(_F32(0.0), builder.gep(floors_p, [this]))
        builder.branch(draw)
        builder.position_at_end(draw)
        x_row = add(_splat(builder, builder.sitofp(column, _F64), 4), off)
        w_row = builder.fptrunc(add(mul(_splat(builder, gx, 4), x_row), slope_y), ir.VectorType(_F32, 4))
        lane = builder.add(_splat(builder, column, 8), ir.Constant(I8, list(range(8))))
        place = builder.add(first_cell, builder.zext(builder.shl(column, I32(6)), ir.IntType(64)))
        for k in range(4):
            here = builder.add(place, ir.IntType(64)(8 * k))
            p = builder.bitcast(builder.gep(cells_p, [here]), I8.as_pointer())
            shown = builder.add(here, ir.IntType(64)(CELL_SAMPLES))
            q = builder.bitcast(builder.gep(cells_p, [shown]), I8.as_pointer())
            old, before = builder.load(p, align=4), builder.load(q, align=4)
            inside = builder.and_(
                builder.icmp_signed(">=", lane, _pick(builder, low, k, 8)),
                builder.icmp_signed("<", lane, _pick(builder, high, k, 8)),
            )
            # The bits of floats that are not negative are ordered as their values are.
            w = builder.bitcast(add(_pick(builder, w_row, k, 8), step), I8)
            w = builder.and_(w, builder.sext(inside, I8))
            nearer = builder.icmp_signed(">", w, old)
            builder.store(builder.select(nearer, w, old), p, align=4)
            _store_all(builder, builder.select(nearer, surface_8, before), q)
        builder.branch(onward)
        builder.position_at_end(onward)
        following = builder.add(column, I32(8))
        column.add_incoming(following, builder.block)
        builder.cbranch(builder.icmp_signed("<", following, column_end), loop, done)
        builder.position_at_end(done)
        return context.get_dummy_value()

    return signature, codegen


def _rows(context, builder, array_type, array, place, step, vector):
    """The four rows of a cell, ``step`` numbers apart."""
    data, rows = array_data(context, builder, array_type, array), []
    for k in range(4):
        here = builder.add(place, builder.mul(step, step.type(k)))
        rows.append(builder.load(builder.bitcast(builder.gep(data, [here]), vector.as_pointer()), align=4))
    return rows


@intrinsic
def pure_columns(typing, cells, place, step):
    """Which of 8 columns show one thing in all four rows, a bit for each; bits 8 to 15: whose first row shows nothing.

    Step 0 looks at one row only.
    """
    signature = types.int32(cells, types.int64, types.int64)

    def codegen(context, builder, sig, args):
        row = _rows(context, builder, sig.args[0], *args, I8)
        same = builder.icmp_signed("==", row[0], row[1])
        for other in row[2:]:
            same = builder.and_(same, builder.icmp_signed("==", row[0], other))
        empty = builder.icmp_signed("<", row[0], ir.Constant(I8, [0] * 8))
        pure, bare = (builder.zext(builder.bitcast(bits, ir.IntType(8)), I32) for bits in (same, empty))
        return builder.or_(pure, builder.shl(bare, I32(8)))

    return signature, codegen


@intrinsic
def _smallest(typing, cells, place):
    """The smallest of the 32 depths of the cell at ``place``: nothing farther can be seen in it."""
    signature = types.float32(cells, types.int64)

    def codegen(context, builder, sig, args):
        row = _rows(context, builder, sig.args[0], *args, ir.IntType(64)(8), F8)
        fold = lambda a, b: builder.select(builder.fcmp_ordered("<", a, b), a, b)  # noqa: E731
        low = fold(fold(row[0], row[1]), fold(row[2], row[3]))
        for half in (4, 2, 1):
            mask = ir.Constant(I8, [(k + half) % 8 for k in range(8)])
            low = fold(low, builder.shuffle_vector(low, ir.Constant(F8, ir.Undefined), mask))
        return builder.extract_element(low, I32(0))

    return signature, codegen


@inner
def farthest(cells, place, count):
    """The smallest 1/z of ``count`` cells of a tile; stops at the first sample without anything."""
    low = np.float32(np.inf)
    for k in range(count):
        low = min(low, _smallest(cells, place + k * CELL))
        if low <= np.float32(0.0):
            break
    return low
