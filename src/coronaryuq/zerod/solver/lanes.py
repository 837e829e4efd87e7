"""A vector of `LANES` doubles as a numba value: one sample per lane, every lane computed by the same instruction.

Plain numba loops over a short inner axis cost more in aliasing checks than in arithmetic. Here `load`, arithmetic and
`store` compile to vector instructions of whatever width the processor has, so that a sample's result cannot depend on
who sits in the other lanes. Kernels that use this module keep numba's cache on; numba does not see when this file
changes, which is why `coronaryuq.core.numba_cache` names the cache's folder by what is in it.
"""

import operator

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, models, overload, register_model

LANES = 16

_VECTOR = ir.VectorType(ir.DoubleType(), LANES)
_BITS = ir.VectorType(ir.IntType(1), LANES)


class LanesType(types.Type):
    """`LANES` doubles."""

    def __init__(self):
        super().__init__(name=f"Lanes{LANES}")


class MaskType(types.Type):
    """`LANES` truth values."""

    def __init__(self):
        super().__init__(name=f"Mask{LANES}")


LANE, MASK = LanesType(), MaskType()


@register_model(LanesType)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager, fe_type):
        super().__init__(manager, fe_type, _VECTOR)


@register_model(MaskType)
class _MaskModel(models.PrimitiveModel):
    def __init__(self, manager, fe_type):
        super().__init__(manager, fe_type, _BITS)


def _row_pointer(context, builder, array_type, array, row):
    data = context.make_array(array_type)(context, builder, array).data
    offset = builder.mul(row, ir.Constant(row.type, LANES))
    return builder.bitcast(builder.gep(data, [offset]), _VECTOR.as_pointer())


def _is_table(array) -> bool:
    return isinstance(array, types.Array) and array.dtype == types.float64 and array.layout == "C" and array.ndim == 2


@intrinsic
def load(typing_context, array, row):
    """Row `row` of a contiguous (rows, LANES) array."""
    if not (_is_table(array) and isinstance(row, types.Integer)):
        return None

    def generate(context, builder, signature, arguments):
        row_number = context.cast(builder, arguments[1], signature.args[1], types.intp)
        return builder.load(_row_pointer(context, builder, signature.args[0], arguments[0], row_number), align=8)

    return LANE(array, row), generate


@intrinsic
def store(typing_context, array, row, value):
    """Write `value` to row `row` of a contiguous (rows, LANES) array."""
    if not (_is_table(array) and isinstance(row, types.Integer) and value == LANE):
        return None

    def generate(context, builder, signature, arguments):
        row_number = context.cast(builder, arguments[1], signature.args[1], types.intp)
        pointer = _row_pointer(context, builder, signature.args[0], arguments[0], row_number)
        builder.store(arguments[2], pointer, align=8)
        return context.get_dummy_value()

    return types.none(array, row, value), generate


@intrinsic
def spread(typing_context, value):
    """The same double in every lane."""

    def generate(context, builder, signature, arguments):
        return _splat(context.cast(builder, arguments[0], signature.args[0], types.float64), builder)

    return LANE(value), generate


def _splat(scalar, builder):
    empty = ir.Constant(_VECTOR, ir.Undefined)
    single = builder.insert_element(empty, scalar, ir.Constant(ir.IntType(32), 0))
    zeros = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
    return builder.shuffle_vector(single, empty, zeros)


def _arithmetic(instruction: str):
    # "contract" lets a product and a sum become one fused instruction, the same one in every lane.
    @intrinsic
    def apply(typing_context, left, right):
        def generate(context, builder, signature, arguments):
            return getattr(builder, instruction)(*arguments, flags=("contract",))

        return LANE(LANE, LANE), generate

    return apply


_add, _subtract, _multiply, _divide = map(_arithmetic, ("fadd", "fsub", "fmul", "fdiv"))


def _as_lanes(kind) -> bool:
    return kind == LANE or isinstance(kind, types.Float)


def _overload_operator(symbol, apply):
    @overload(symbol)
    def implementation(left, right):
        if left == LANE and right == LANE:
            return lambda left, right: apply(left, right)
        if left == LANE and isinstance(right, types.Float):
            return lambda left, right: apply(left, spread(right))
        if right == LANE and isinstance(left, types.Float):
            return lambda left, right: apply(spread(left), right)
        return None


for _symbol, _apply in (
    (operator.add, _add),
    (operator.sub, _subtract),
    (operator.mul, _multiply),
    (operator.truediv, _divide),
):
    _overload_operator(_symbol, _apply)


def _comparison(predicate: str):
    @intrinsic
    def compare(typing_context, left, right):
        def generate(context, builder, signature, arguments):
            return builder.fcmp_ordered(predicate, *arguments)

        return MASK(LANE, LANE), generate

    return compare


less, less_equal = _comparison("<"), _comparison("<=")


@intrinsic
def both(typing_context, left, right):
    """Lanes where both masks hold."""
    return MASK(MASK, MASK), lambda context, builder, signature, arguments: builder.and_(*arguments)


@intrinsic
def choose(typing_context, mask, where, otherwise):
    """`where` in lanes where the mask holds, `otherwise` in the others."""
    return (
        LANE(MASK, LANE, LANE),
        lambda context, builder, signature, arguments: builder.select(*arguments),
    )


@intrinsic
def any_lane(typing_context, mask):
    """Whether the mask holds in some lane."""

    def generate(context, builder, signature, arguments):
        bits = builder.bitcast(arguments[0], ir.IntType(LANES))
        return builder.icmp_unsigned("!=", bits, ir.Constant(bits.type, 0))

    return types.boolean(MASK), generate


def _unary(name: str):
    @intrinsic
    def apply(typing_context, value):
        def generate(context, builder, signature, arguments):
            function = cgutils.get_or_insert_function(
                builder.module, ir.FunctionType(_VECTOR, [_VECTOR]), f"llvm.{name}.v{LANES}f64"
            )
            return builder.call(function, arguments)

        return LANE(LANE), generate

    return apply


magnitude, nearest = _unary("fabs"), _unary("rint")


@intrinsic
def power_of_two(typing_context, exponent):
    """2**k for whole k between −1022 and 1023, exactly."""

    def generate(context, builder, signature, arguments):
        whole = ir.VectorType(ir.IntType(64), LANES)
        bits = builder.fptosi(arguments[0], whole)
        biased = builder.add(bits, ir.Constant(whole, [1023] * LANES))
        return builder.bitcast(builder.shl(biased, ir.Constant(whole, [52] * LANES)), _VECTOR)

    return LANE(LANE), generate


def table(rows: int, fill: float = 0.0) -> np.ndarray:
    """A (rows, LANES) array that starts on a cache line."""
    room = np.empty(rows * LANES + 8)
    skip = (-room.ctypes.data // 8) % 8
    aligned = room[skip : skip + rows * LANES].reshape(rows, LANES)
    aligned[:] = fill
    return aligned
