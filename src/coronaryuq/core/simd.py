"""Vectors of doubles as numba values: one sample per lane, every lane computed by the same instructions.

Plain numba loops over a short inner axis cost more in aliasing checks than in arithmetic, and the vectoriser gives up,
because it must assume that arrays overlap. Here `load`, arithmetic and `store` compile to vector instructions of
whatever width the processor has, so that a sample's result cannot depend on the other lanes. Kernels that use this
module keep numba's cache on; numba does not see when this file changes, which is why `core.numba_cache` names the cache
folder by the content of all files with kernels.
"""

import operator
from collections.abc import Callable

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, models, overload, register_model


class LanesType(types.Type):
    """Vector of `count` doubles; with `contract`, a product and a sum may become one fused instruction."""

    def __init__(self, count: int, contract: bool = False):
        super().__init__(name=f"Lanes{count}{'Contract' if contract else ''}")
        self.count, self.contract = count, contract

    def of(self, element: ir.Type) -> ir.VectorType:
        return ir.VectorType(element, self.count)


class MaskType(types.Type):
    """Vector of `count` truth values."""

    def __init__(self, count: int):
        super().__init__(name=f"Mask{count}")
        self.count = count


@register_model(LanesType)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager, kind):
        super().__init__(manager, kind, kind.of(ir.DoubleType()))


@register_model(MaskType)
class _MaskModel(models.PrimitiveModel):
    def __init__(self, manager, kind):
        super().__init__(manager, kind, ir.VectorType(ir.IntType(1), kind.count))


def _row_pointer(context, builder, lanes, array_type, array, row):
    data = context.make_array(array_type)(context, builder, array).data
    place = builder.gep(data, [builder.mul(row, ir.Constant(row.type, lanes.count))])
    element = ir.DoubleType() if array_type.dtype == types.float64 else ir.FloatType()
    return builder.bitcast(place, lanes.of(element).as_pointer())


def _is_table(array) -> bool:
    return isinstance(array, types.Array) and array.dtype in (types.float64, types.float32) and array.layout == "C"


def _splat(builder, lanes, number):
    empty = ir.Constant(lanes.of(ir.DoubleType()), ir.Undefined)
    first = builder.insert_element(empty, number, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(first, empty, ir.Constant(lanes.of(ir.IntType(32)), [0] * lanes.count))


def vectors(lanes: LanesType) -> tuple[Callable, Callable]:
    """Return the two intrinsics that make vectors of one type.

    Parameters
    ----------
    lanes : LanesType
        Type of the vectors.

    Returns
    -------
    load : callable
        `load(array, row)` reads a row of a contiguous array of doubles or floats with shape (..., lanes.count).
    splat : callable
        `splat(number)` puts the same number in every lane.
    """

    @intrinsic
    def load(typing_context, array, row):
        if not (_is_table(array) and isinstance(row, types.Integer)):
            return None

        def generate(context, builder, signature, arguments):
            pointer = _row_pointer(context, builder, lanes, signature.args[0], *arguments)
            value = builder.load(pointer, align=array.dtype.bitwidth // 8)
            return value if array.dtype == types.float64 else builder.fpext(value, lanes.of(ir.DoubleType()))

        return lanes(array, types.intp), generate

    @intrinsic
    def splat(typing_context, number):
        def generate(context, builder, signature, arguments):
            return _splat(builder, lanes, *arguments)

        return lanes(types.float64), generate

    return load, splat


@intrinsic
def store(typing_context, array, row, value):
    """Write `value` to row `row` of a contiguous array, rounding if it is an array of floats."""
    if not (_is_table(array) and isinstance(row, types.Integer) and isinstance(value, LanesType)):
        return None

    def generate(context, builder, signature, arguments):
        pointer = _row_pointer(context, builder, value, signature.args[0], *arguments[:2])
        vector = arguments[2]
        if array.dtype == types.float32:
            vector = builder.fptrunc(vector, value.of(ir.FloatType()))
        builder.store(vector, pointer, align=array.dtype.bitwidth // 8)
        return context.get_dummy_value()

    return types.none(array, types.intp, value), generate


@intrinsic
def _splat_like(typing_context, vector, number):
    def generate(context, builder, signature, arguments):
        return _splat(builder, vector, arguments[1])

    return vector(vector, types.float64), generate


def _arithmetic(symbol: Callable, instruction: str) -> None:
    """Let an operator act on two vectors, or on a vector and a number."""

    @intrinsic
    def apply(typing_context, left, right):
        flags = ("contract",) if left.contract else ()

        def generate(context, builder, signature, arguments):
            return getattr(builder, instruction)(*arguments, flags=flags)

        return left(left, left), generate

    @overload(symbol)
    def implementation(left, right):
        numbers = types.Float | types.Integer
        if isinstance(left, LanesType) and isinstance(right, LanesType):
            return lambda left, right: apply(left, right)
        if isinstance(left, LanesType) and isinstance(right, numbers):
            return lambda left, right: apply(left, _splat_like(left, right))
        if isinstance(right, LanesType) and isinstance(left, numbers):
            return lambda left, right: apply(_splat_like(right, left), right)
        return None


_arithmetic(operator.add, "fadd")
_arithmetic(operator.sub, "fsub")
_arithmetic(operator.mul, "fmul")
_arithmetic(operator.truediv, "fdiv")


def _function(name: str, operands: int) -> Callable:
    """Declare an LLVM intrinsic with this number of vector operands."""

    def emit(builder, lanes, arguments):
        vector = lanes.of(ir.DoubleType())
        kind = ir.FunctionType(vector, [vector] * operands)
        function = cgutils.get_or_insert_function(builder.module, kind, f"llvm.{name}.v{lanes.count}f64")
        return builder.call(function, arguments)

    @intrinsic
    def unary(typing_context, value):
        return value(value), lambda context, builder, signature, arguments: emit(builder, value, arguments)

    @intrinsic
    def ternary(typing_context, a, b, c):
        return b(b, b, b), lambda context, builder, signature, arguments: emit(builder, b, arguments)

    return unary if operands == 1 else ternary


absolute, nearest, square_root = _function("fabs", 1), _function("rint", 1), _function("sqrt", 1)
_fused = _function("fma", 3)


def fma(a, b, c):
    """Compute a · b + c, rounded once; a may be a number."""
    raise NotImplementedError("for numba kernels only")


@overload(fma)
def _choose_fma(a, b, c):
    if isinstance(a, LanesType):
        return lambda a, b, c: _fused(a, b, c)
    return lambda a, b, c: _fused(_splat_like(b, a), b, c)


def _comparison(predicate: str) -> Callable:
    @intrinsic
    def compare(typing_context, left, right):
        def generate(context, builder, signature, arguments):
            return builder.fcmp_ordered(predicate, *arguments)

        return MaskType(left.count)(left, right), generate

    return compare


less, less_equal = _comparison("<"), _comparison("<=")


@intrinsic
def both(typing_context, left, right):
    """Lanes where both masks hold."""
    return left(left, right), lambda context, builder, signature, arguments: builder.and_(*arguments)


@intrinsic
def choose(typing_context, mask, where, otherwise):
    """`where` in lanes where the mask holds, `otherwise` in the others."""
    return (
        where(mask, where, where),
        lambda context, builder, signature, arguments: builder.select(*arguments),
    )


@intrinsic
def any_lane(typing_context, mask):
    """Whether the mask holds in some lane."""

    def generate(context, builder, signature, arguments):
        bits = builder.bitcast(arguments[0], ir.IntType(mask.count))
        return builder.icmp_unsigned("!=", bits, ir.Constant(bits.type, 0))

    return types.boolean(mask), generate


@intrinsic
def power_of_two(typing_context, exponent):
    """2**k for whole k between −1022 and 1023, exactly."""

    def generate(context, builder, signature, arguments):
        whole = exponent.of(ir.IntType(64))
        biased = builder.add(builder.fptosi(arguments[0], whole), ir.Constant(whole, [1023] * exponent.count))
        bits = builder.shl(biased, ir.Constant(whole, [52] * exponent.count))
        return builder.bitcast(bits, exponent.of(ir.DoubleType()))

    return exponent(exponent), generate
