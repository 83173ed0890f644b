"""Words that cannot be generated names, because they have a meaning in Modelica or C."""

from __future__ import annotations


def _set(text: str) -> frozenset[str]:
    return frozenset(text.split())


_MODELICA = _set("""
    algorithm and annotation assert block break class connect connector constant constrainedby der
    discrete each else elseif elsewhen encapsulated end enumeration equation expandable extends
    external false final flow for function if import impure in initial inner input loop model not
    operator or outer output package parameter partial protected public pure record redeclare
    replaceable return stream then true type when while within
""")

_MODELICA_BUILT_IN = _set("""
    Real Integer Boolean String ExternalObject StateSelect AssertionLevel Clock time abs acos
    actualStream asin atan atan2 backSample cardinality ceil change cos cosh cross delay diagonal
    div edge exp fill floor getInstanceName hold homotopy identity inStream integer interval
    linspace log log10 matrix max min mod ndims noClock noEvent ones outerProduct pre previous
    product promote reinit rem sample scalar semiLinear shiftSample sign sin sinh size skew smooth
    spatialDistribution sqrt subSample sum superSample symmetric tan tanh terminal terminate
    transpose vector zeros
""")

_C = _set("""
    alignas alignof asm auto bool break case catch char class complex concept const consteval
    constexpr constinit continue decltype default delete do double else enum errno explicit
    export extern false float for friend goto if imaginary inline int linux long mutable
    namespace new noexcept noreturn nullptr operator private protected public register requires
    restrict return short signed sizeof static stderr stdin stdout struct switch template this
    throw true try typedef typeid typename typeof union unix unsigned using virtual void
    volatile while xor
""")
"""Of C and C++, with macros of the standard headers."""

WORDS = _MODELICA | _MODELICA_BUILT_IN | _C
