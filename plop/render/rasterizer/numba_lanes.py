"""Sixteen float32 in one register, for kernels that must not depend on what the compiler finds to vectorise.

`+ - * /` work lane by lane; numbers are made lanes by `spread`. On processors with narrower registers the compiler
uses several.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, models, register_model

LANES = 16
"""Numbers in a register; also the length of a row of sums, one cache line."""
_VECTOR, _ORDER = ir.VectorType(ir.FloatType(), LANES), ir.VectorType(ir.IntType(32), LANES)
_FAST = ("reassoc", "contract", "nsz", "arcp", "afn")


class _Lanes(types.Type):
    def __init__(self) -> None:
        super().__init__(name="Lanes")


_lanes = _Lanes()


@register_model(_Lanes)
class _Model(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, dmm: Any, fe_type: Any) -> None:
        super().__init__(dmm, fe_type, _VECTOR)


def _add_operator(symbol: Any, instruction: str) -> None:
    @infer_global(symbol)
    class _Typing(AbstractTemplate):  # type: ignore[misc]
        def generic(self, args: Any, kws: Any) -> Any:
            return signature(_lanes, *args) if args == (_lanes, _lanes) else None

    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return getattr(builder, instruction)(*args, flags=_FAST)

    lower_builtin(symbol, _lanes, _lanes)(code)


for _symbol, _instruction in (("add", "fadd"), ("iadd", "fadd"), ("sub", "fsub"), ("mul", "fmul"), ("truediv", "fdiv")):
    _add_operator(getattr(operator, _symbol), _instruction)


def _built_in(function: Callable[..., Any]) -> Callable[..., Any]:
    """Make a function that returns a signature and the code for it callable from kernels."""
    made: Callable[..., Any] = intrinsic(function)
    return made


def _pointer(context: Any, builder: Any, kind: Any, array: Any, index: Any) -> Any:
    data = context.make_array(kind)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), _VECTOR.as_pointer())


@_built_in
def load(typing: Any, array: Any, index: Any) -> Any:
    """Return the lanes array[index : index + LANES] of a contiguous float32 array; no bounds are checked."""

    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.load(_pointer(context, builder, sig.args[0], *args), align=4)

    return _lanes(array, types.intp), code


@_built_in
def store(typing: Any, array: Any, index: Any, values: Any) -> Any:
    """Write lanes to array[index : index + LANES]; no bounds are checked."""

    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        builder.store(args[2], _pointer(context, builder, sig.args[0], *args[:2]), align=4)
        return context.get_dummy_value()

    return types.none(array, types.intp, _lanes), code


@_built_in
def spread(typing: Any, value: Any) -> Any:
    """Return a float32 in every lane."""

    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        one = builder.insert_element(ir.Constant(_VECTOR, ir.Undefined), args[0], ir.Constant(ir.IntType(32), 0))
        return builder.shuffle_vector(one, ir.Constant(_VECTOR, ir.Undefined), ir.Constant(_ORDER, [0] * LANES))

    return _lanes(types.float32), code


@_built_in
def where_less(typing: Any, a: Any, b: Any, yes: Any, no: Any) -> Any:
    """Return, lane by lane, `yes` where a < b, else `no`."""

    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.select(builder.fcmp_ordered("<", args[0], args[1]), args[2], args[3])

    return _lanes(_lanes, _lanes, _lanes, _lanes), code


@_built_in
def minus_abs(typing: Any, values: Any) -> Any:
    """Return -|value| of each lane."""

    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        sign = ir.Constant(_ORDER, [-(2**31)] * LANES)
        return builder.bitcast(builder.or_(builder.bitcast(args[0], _ORDER), sign), _VECTOR)

    return _lanes(_lanes), code


@_built_in
def totals(typing: Any, values: Any) -> Any:
    """Return the sums over the lanes of up to LANES values, one in each lane, zeros after them."""

    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        parts = cgutils.unpack_tuple(builder, args[0])
        for half in (8, 4, 2, 1):
            parts += [ir.Constant(_VECTOR, [0.0] * LANES)] * (len(parts) % 2)
            left = [lane for lane in range(2 * LANES) if lane // half % 2 == 0]
            right = [lane + half for lane in left]
            folded = []
            for pair in zip(parts[::2], parts[1::2], strict=True):
                halves = [builder.shuffle_vector(*pair, ir.Constant(_ORDER, lanes)) for lanes in (left, right)]
                folded.append(builder.fadd(*halves, flags=_FAST))
            parts = folded
        return parts[0]

    return _lanes(values), code


@_built_in
def prefetch(typing: Any, array: Any, index: Any) -> Any:
    """Bring the cache line of array[index] here, to be written."""

    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        i32 = ir.IntType(32)
        pointer = builder.bitcast(_pointer(context, builder, sig.args[0], *args), ir.IntType(8).as_pointer())
        kind = ir.FunctionType(ir.VoidType(), [ir.IntType(8).as_pointer(), i32, i32, i32])
        fetch = builder.module.declare_intrinsic("llvm.prefetch.p0", fnty=kind)
        builder.call(fetch, [pointer, i32(1), i32(3), i32(1)])
        return context.get_dummy_value()

    return types.none(array, types.intp), code
