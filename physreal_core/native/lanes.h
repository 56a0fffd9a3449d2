// Lanes<S, N>: N numbers of type S that go through the same arithmetic at once, in as many vector registers as the machine
// needs for them. Operators act lane by lane; a comparison gives a Mask, and `mask ? a : b` chooses lane by lane.
#pragma once

namespace physreal {

template <class S> struct Bits;  // the signed integer of the same width; of two such types, the one comparisons give
template <> struct Bits<float> { using type = int; };
#if __SIZEOF_LONG__ == 8
template <> struct Bits<double> { using type = long; };
#else
template <> struct Bits<double> { using type = long long; };
#endif

template <class S, int N> using Lanes = S __attribute__((ext_vector_type(N)));
template <class S, int N> using Mask = typename Bits<S>::type __attribute__((ext_vector_type(N)));

// Lanes in one register of this machine.
#if defined(__AVX512F__)
template <class S> constexpr int register_lanes = 64 / sizeof(S);
#elif defined(__AVX__)
template <class S> constexpr int register_lanes = 32 / sizeof(S);
#else
template <class S> constexpr int register_lanes = 16 / sizeof(S);
#endif

template <class S, int N> inline Lanes<S, N> load(const S* from)
{
    Lanes<S, N> lanes;
    __builtin_memcpy(&lanes, from, sizeof(lanes));
    return lanes;
}

template <class S, int N> inline void store(S* to, Lanes<S, N> lanes) { __builtin_memcpy(to, &lanes, sizeof(lanes)); }

// 0, 1, 2, ...
template <class S, int N> inline Lanes<S, N> iota()
{
    Lanes<S, N> lanes;
    for (int i = 0; i < N; ++i)
        lanes[i] = S(i);
    return lanes;
}

// Sum over the lanes, by halves: the order does not depend on the machine.
template <class S, int N> inline S sum(Lanes<S, N> lanes)
{
    if constexpr (N == 1)
        return lanes[0];
    else
        return sum<S, N / 2>(lanes.lo + lanes.hi);
}

// Sums over the lanes of N vectors, each in the lane of its place.
template <class S, int N> inline Lanes<S, N> sums(const Lanes<S, N> (&values)[N])
{
    Lanes<S, N> level[N];
    for (int i = 0; i < N; ++i)
        level[i] = values[i];
#pragma unroll
    for (int count = N / 2; count > 0; count /= 2)
#pragma unroll
        for (int i = 0; i < count; ++i) {
            const Lanes<S, N> a = level[2 * i], b = level[2 * i + 1];
            Lanes<S, N> even, odd;
            even.lo = a.even, even.hi = b.even, odd.lo = a.odd, odd.hi = b.odd;
            level[i] = even + odd;
        }
    return level[0];
}

// Bit i of the result is lane i of the mask.
template <class I> inline unsigned bits(Lanes<I, 16> mask)
{
    using Bools = bool __attribute__((ext_vector_type(16)));
    return __builtin_bit_cast(unsigned short, __builtin_convertvector(mask, Bools));
}

template <class I, int N> inline bool any(Lanes<I, N> mask) { return __builtin_reduce_or(mask) != 0; }
template <class I, int N> inline bool all(Lanes<I, N> mask) { return __builtin_reduce_and(mask) != 0; }

// exp(x) = 2^n e^r with |r| <= ln 2 / 2 and e^r by its Taylor polynomial: within 2 units in the last place. NaN stays NaN;
// beyond `highest` and `lowest` x counts as the bound, where the result is still a normal number.
template <class S> struct Exponential;
template <> struct Exponential<float>
{
    static constexpr int terms = 6, mantissa = 23, bias = 127;
    static constexpr float highest = 88.f, lowest = -87.f, round = 12582912.f;  // 1.5 * 2^23: its last bit counts ones
    static constexpr float ln2_high = 0.693359375f, ln2_low = -2.12194440e-4f;
};
template <> struct Exponential<double>
{
    static constexpr int terms = 13, mantissa = 52, bias = 1023;
    static constexpr double highest = 709., lowest = -708., round = 6755399441055744.;  // 1.5 * 2^52
    static constexpr double ln2_high = 6.93147180369123816490e-01, ln2_low = 1.90821492927058770002e-10;
};

template <class S, int N> inline Lanes<S, N> exp(Lanes<S, N> x)
{
    using E = Exponential<S>;
    x = x > E::highest ? Lanes<S, N>(E::highest) : x;
    x = x < E::lowest ? Lanes<S, N>(E::lowest) : x;
    const Lanes<S, N> shifted = x * S(1.4426950408889634) + E::round;
    const Lanes<S, N> n = shifted - E::round;
    const Lanes<S, N> r = (x - n * E::ln2_high) - n * E::ln2_low;
    S factorials[E::terms + 1] = {S(1)};
    for (int i = 1; i <= E::terms; ++i)
        factorials[i] = factorials[i - 1] * S(i);
    Lanes<S, N> p = S(1) / factorials[E::terms];
#pragma unroll
    for (int i = E::terms - 1; i >= 0; --i)
        p = p * r + S(1) / factorials[i];
    using Integers = Mask<S, N>;
    const Integers power = (__builtin_bit_cast(Integers, shifted) + E::bias) << E::mantissa;
    return p * __builtin_bit_cast(Lanes<S, N>, power);
}

// 2^x for x between the smallest and the largest exponent of a normal number; beyond them the result means nothing.
template <class S, int N> inline Lanes<S, N> exp2_between(Lanes<S, N> x)
{
    using E = Exponential<S>;
    using Integers = Mask<S, N>;
    const Lanes<S, N> shifted = x + E::round;
    const Lanes<S, N> r = x - (shifted - E::round);
    S coefficients[E::terms + 1] = {S(1)};
    for (int i = 1; i <= E::terms; ++i)
        coefficients[i] = coefficients[i - 1] * S(0.6931471805599453) / S(i);
    Lanes<S, N> p = coefficients[E::terms];
#pragma unroll
    for (int i = E::terms - 1; i >= 0; --i)
        p = p * r + coefficients[i];
    const Integers power = (__builtin_bit_cast(Integers, shifted) + E::bias) << E::mantissa;
    return p * __builtin_bit_cast(Lanes<S, N>, power);
}

// log(x) for normal x > 0: x = 2^n m with m in [sqrt(1/2), sqrt(2)), log m = 2 artanh((m - 1) / (m + 1)) by its series.
// Zero and below give NaN, as does NaN.
template <class S> struct Logarithm;
template <> struct Logarithm<float> { static constexpr int terms = 5; };
template <> struct Logarithm<double> { static constexpr int terms = 11; };

template <class S, int N> inline Lanes<S, N> log(Lanes<S, N> x)
{
    using E = Exponential<S>;
    using Integer = typename Bits<S>::type;
    using Integers = Mask<S, N>;
    const Integer half = __builtin_bit_cast(Integer, S(0.7071067811865476));
    const Integers n = (__builtin_bit_cast(Integers, x) - half) >> E::mantissa;
    const Lanes<S, N> m = __builtin_bit_cast(Lanes<S, N>, __builtin_bit_cast(Integers, x) - (n << E::mantissa));
    const Lanes<S, N> s = (m - S(1)) / (m + S(1)), t = s * s;
    Lanes<S, N> p = S(1) / S(2 * Logarithm<S>::terms + 1);
#pragma unroll
    for (int i = Logarithm<S>::terms - 1; i >= 0; --i)
        p = p * t + S(1) / S(2 * i + 1);
    const Lanes<S, N> exponent = __builtin_convertvector(n, Lanes<S, N>);
    const Lanes<S, N> value = exponent * E::ln2_high + (S(2) * s * p + exponent * E::ln2_low);
    return x > S(0) ? value : Lanes<S, N>(S(__builtin_nanf("")));
}

template <class S, int N> inline Lanes<S, N> sqrt(Lanes<S, N> x) { return __builtin_elementwise_sqrt(x); }
template <class S, int N> inline Lanes<S, N> ceil(Lanes<S, N> x) { return __builtin_elementwise_ceil(x); }
template <class S, int N> inline Lanes<S, N> floor(Lanes<S, N> x) { return __builtin_elementwise_floor(x); }
template <class S, int N> inline Lanes<S, N> min(Lanes<S, N> a, Lanes<S, N> b) { return a < b ? a : b; }
template <class S, int N> inline Lanes<S, N> max(Lanes<S, N> a, Lanes<S, N> b) { return a > b ? a : b; }

}  // namespace physreal
