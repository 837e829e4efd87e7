"""How many samples advance side by side, and a vector of them for numba kernels.

Every array has the sample index innermost, LANES long. Kernels read a row of an array into one machine vector, compute
with `+ - *`, `fma`, `absolute`, `square_root`, and store it back. The vectoriser cannot do this by itself, because it
must suppose that the arrays overlap. Each lane sees the same operations in the same order whatever the others hold.
Numba does not see when this file changes, which is why `coronaryuq.core.numba_cache` names the cache folder by its
content.
"""

import operator

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, models, overload, register_model

LANES = 8
"""Samples per lane block; a block with fewer samples is padded with copies of its last."""

_DOUBLES = ir.VectorType(ir.DoubleType(), LANES)
_FLOATS = ir.VectorType(ir.FloatType(), LANES)


class LanesType(types.Type):
    def __init__(self):
        super().__init__(name=f"lanes{LANES}")


lanes_type = LanesType()


@register_model(LanesType)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager, kind):
        super().__init__(manager, kind, _DOUBLES)


def _row(context, builder, kind, array, index):
    data = context.make_array(kind)(context, builder, array).data
    vector = _DOUBLES if kind.dtype == types.float64 else _FLOATS
    place = builder.gep(data, [builder.mul(index, ir.Constant(index.type, LANES))])
    return builder.bitcast(place, vector.as_pointer())


def _itemsize(kind):
    return 8 if kind.dtype == types.float64 else 4


@intrinsic
def load(typingctx, array, row):
    """Row `row` of a contiguous array of doubles or floats whose last dimension is LANES, as doubles."""

    def generate(context, builder, signature, arguments):
        kind = signature.args[0]
        value = builder.load(_row(context, builder, kind, *arguments), align=_itemsize(kind))
        return value if kind.dtype == types.float64 else builder.fpext(value, _DOUBLES)

    return lanes_type(array, types.intp), generate


@intrinsic
def store(typingctx, array, row, value):
    """Write a vector into row `row`, rounding where the array holds floats."""

    def generate(context, builder, signature, arguments):
        kind = signature.args[0]
        value = arguments[2] if kind.dtype == types.float64 else builder.fptrunc(arguments[2], _FLOATS)
        builder.store(value, _row(context, builder, kind, *arguments[:2]), align=_itemsize(kind))
        return context.get_dummy_value()

    return types.void(array, types.intp, lanes_type), generate


@intrinsic
def splat(typingctx, number):
    """The same number in every lane."""

    def generate(context, builder, signature, arguments):
        value = arguments[0]
        first = builder.insert_element(ir.Constant(_DOUBLES, ir.Undefined), value, ir.Constant(ir.IntType(32), 0))
        mask = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
        return builder.shuffle_vector(first, ir.Constant(_DOUBLES, ir.Undefined), mask)

    return lanes_type(types.float64), generate


def _binary(name):
    @intrinsic
    def operation(typingctx, a, b):
        def generate(context, builder, signature, arguments):
            return getattr(builder, name)(*arguments)

        return lanes_type(lanes_type, lanes_type), generate

    return operation


def _unary(name):
    @intrinsic
    def operation(typingctx, a):
        def generate(context, builder, signature, arguments):
            function = cgutils.get_or_insert_function(
                builder.module, ir.FunctionType(_DOUBLES, [_DOUBLES]), f"llvm.{name}.v{LANES}f64"
            )
            return builder.call(function, arguments)

        return lanes_type(lanes_type), generate

    return operation


_add, _subtract, _multiply, _divide = _binary("fadd"), _binary("fsub"), _binary("fmul"), _binary("fdiv")
absolute, square_root = _unary("fabs"), _unary("sqrt")


@intrinsic
def _fused(typingctx, a, b, c):
    def generate(context, builder, signature, arguments):
        function = cgutils.get_or_insert_function(
            builder.module, ir.FunctionType(_DOUBLES, [_DOUBLES] * 3), f"llvm.fma.v{LANES}f64"
        )
        return builder.call(function, arguments)

    return lanes_type(lanes_type, lanes_type, lanes_type), generate


@intrinsic
def minimum(typingctx, a, b):
    """Lane by lane, the smaller one."""

    def generate(context, builder, signature, arguments):
        a, b = arguments
        return builder.select(builder.fcmp_ordered("<", a, b), a, b)

    return lanes_type(lanes_type, lanes_type), generate


def _lift(value):
    """Compile-time choice: numbers are spread over the lanes, vectors stay."""
    return isinstance(value, LanesType)


def _overload(operation, implementation):
    @overload(operation)
    def choose(a, b):
        if _lift(a) and _lift(b):
            return lambda a, b: implementation(a, b)
        if _lift(a) and isinstance(b, types.Float | types.Integer):
            return lambda a, b: implementation(a, splat(b))
        if _lift(b) and isinstance(a, types.Float | types.Integer):
            return lambda a, b: implementation(splat(a), b)


for _operation, _implementation in (
    (operator.add, _add), (operator.sub, _subtract), (operator.mul, _multiply), (operator.truediv, _divide),
):  # fmt: skip
    _overload(_operation, _implementation)


def fma(a, b, c):
    """a · b + c, rounded once; a may be a number."""
    raise NotImplementedError("for numba kernels only")


@overload(fma)
def _choose_fma(a, b, c):
    if _lift(a):
        return lambda a, b, c: _fused(a, b, c)
    return lambda a, b, c: _fused(splat(a), b, c)
