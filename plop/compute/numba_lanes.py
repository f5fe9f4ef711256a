"""Sixteen or four float32 in one register, for kernels that must not depend on what the compiler finds to vectorise.

`+ - * /` work lane by lane; numbers are made lanes by `spread` or `pack4`. On processors with narrower registers the
compiler uses several.
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
_I32 = ir.IntType(32)
_FAST = ("reassoc", "contract", "nsz", "arcp", "afn")


class _Lanes(types.Type):
    def __init__(self, count: int) -> None:
        super().__init__(name=f"Lanes{count}")
        self.count = count

    @property
    def vector(self) -> Any:
        return ir.VectorType(ir.FloatType(), self.count)

    def order(self, numbers: list[int]) -> Any:
        return ir.Constant(ir.VectorType(_I32, len(numbers)), numbers)


_sixteen, _four = _Lanes(LANES), _Lanes(4)


@register_model(_Lanes)
class _Model(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, dmm: Any, fe_type: Any) -> None:
        super().__init__(dmm, fe_type, fe_type.vector)


def _add_operator(symbol: Any, instruction: str) -> None:
    @infer_global(symbol)
    class _Typing(AbstractTemplate):  # type: ignore[misc]
        def generic(self, args: Any, kws: Any) -> Any:
            return signature(args[0], *args) if isinstance(args[0], _Lanes) and args[1:] == args[:1] else None

    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return getattr(builder, instruction)(*args, flags=_FAST)

    lower_builtin(symbol, _Lanes, _Lanes)(code)


for _symbol, _instruction in (("add", "fadd"), ("iadd", "fadd"), ("sub", "fsub"), ("mul", "fmul"), ("truediv", "fdiv")):
    _add_operator(getattr(operator, _symbol), _instruction)


def _built_in(function: Callable[..., Any]) -> Callable[..., Any]:
    """Make a function that returns a signature and the code for it callable from kernels."""
    made: Callable[..., Any] = intrinsic(prefer_literal=True)(function)
    return made


def _pointer(context: Any, builder: Any, kind: Any, array: Any, index: Any, lanes: _Lanes) -> Any:
    data = context.make_array(kind)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), lanes.vector.as_pointer())


def _loads(lanes: _Lanes) -> Callable[..., Any]:
    def load(typing: Any, array: Any, index: Any) -> Any:
        def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            return builder.load(_pointer(context, builder, sig.args[0], args[0], args[1], lanes), align=4)

        return lanes(array, types.intp), code

    return _built_in(load)


def _spreads(lanes: _Lanes) -> Callable[..., Any]:
    def spread(typing: Any, value: Any) -> Any:
        def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            none = ir.Constant(lanes.vector, ir.Undefined)
            one = builder.insert_element(none, args[0], _I32(0))
            return builder.shuffle_vector(one, none, lanes.order([0] * lanes.count))

        return lanes(types.float32), code

    return _built_in(spread)


load, load4 = _loads(_sixteen), _loads(_four)
"""Return the lanes array[index : index + count] of a contiguous float32 array, by its flat index; no bounds are
checked."""
spread, spread4 = _spreads(_sixteen), _spreads(_four)
"""Return a float32 in every lane."""


@_built_in
def pack4(typing: Any, values: Any) -> Any:
    """Return four lanes from four float32."""

    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        packed = ir.Constant(_four.vector, ir.Undefined)
        for k, value in enumerate(cgutils.unpack_tuple(builder, args[0])):
            packed = builder.insert_element(packed, value, _I32(k))
        return packed

    return _four(values), code


@_built_in
def lane(typing: Any, values: Any, number: Any) -> Any:
    """Return one of the lanes; its number is a constant."""

    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.extract_element(args[0], _I32(number.literal_value))

    return types.float32(values, number), code


@_built_in
def store(typing: Any, array: Any, index: Any, values: Any) -> Any:
    """Write lanes to array[index : index + count], by its flat index; no bounds are checked."""

    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        builder.store(args[2], _pointer(context, builder, sig.args[0], args[0], args[1], values), align=4)
        return context.get_dummy_value()

    return types.none(array, types.intp, values), code


@_built_in
def where_less(typing: Any, a: Any, b: Any, yes: Any, no: Any) -> Any:
    """Return, lane by lane, `yes` where a < b, else `no`."""

    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.select(builder.fcmp_ordered("<", args[0], args[1]), args[2], args[3])

    return a(a, b, yes, no), code


@_built_in
def minus_abs(typing: Any, values: Any) -> Any:
    """Return -|value| of each lane."""

    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        sign = values.order([-(2**31)] * values.count)
        return builder.bitcast(builder.or_(builder.bitcast(args[0], sign.type), sign), values.vector)

    return values(values), code


@_built_in
def totals(typing: Any, values: Any) -> Any:
    """Return the sums over the lanes of up to LANES values, one in each lane, zeros after them."""

    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        parts = cgutils.unpack_tuple(builder, args[0])
        for half in (8, 4, 2, 1):
            parts += [ir.Constant(_sixteen.vector, [0.0] * LANES)] * (len(parts) % 2)
            left = [lane for lane in range(2 * LANES) if lane // half % 2 == 0]
            right = [lane + half for lane in left]
            folded = []
            for pair in zip(parts[::2], parts[1::2], strict=True):
                halves = [builder.shuffle_vector(*pair, _sixteen.order(lanes)) for lanes in (left, right)]
                folded.append(builder.fadd(*halves, flags=_FAST))
            parts = folded
        return parts[0]

    return _sixteen(values), code


@_built_in
def prefetch(typing: Any, array: Any, index: Any) -> Any:
    """Bring the cache line of array[index] here, to be written."""

    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        pointer = builder.bitcast(
            _pointer(context, builder, sig.args[0], args[0], args[1], _sixteen), ir.IntType(8).as_pointer()
        )
        kind = ir.FunctionType(ir.VoidType(), [ir.IntType(8).as_pointer(), _I32, _I32, _I32])
        fetch = builder.module.declare_intrinsic("llvm.prefetch.p0", fnty=kind)
        builder.call(fetch, [pointer, _I32(1), _I32(3), _I32(1)])
        return context.get_dummy_value()

    return types.none(array, types.intp), code
